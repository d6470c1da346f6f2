# SPDX-License-Identifier: Apache-2.0
"""The plant map of a laser scan of real cotton, beside the branches that others cut it into.

    python tests/accuracy/real_clouds.py FOLDER

FOLDER is Horizontal/TreeQSM/distribution of UGA-BSAIL/cotton_organ_mapping (research terms: measured, never committed):
a field plant of 1.2 m, `treeqsm/PLANT/trunk.txt` and `restore/PLANT/K_restore.txt`, a file for each branch at the stem
with x y z in m and a colour for wood or lint. Its authors found them by TreeQSM, the lint by PointNet++. Here the cloud
is one again, its lint parted into bolls where 8 mm lie between, and all else is `measure_cloud`. A branch at the stem
is right if most of its way, with all that grows on it, lies in one of theirs, and no other does; a boll, if it hangs on
theirs. Prints a table, a row a branch, and writes FOLDER/map_PLANT.png.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import numpy as np
import pandas as pd
from markdown_tables import markdown
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from cotton3dg.core.libraries import import_open3d
from cotton3dg.core.plant_map import PlantMap
from cotton3dg.evaluation.cloud import find_foot, measure_cloud
from cotton3dg.geometry.polylines import length_of, resampled
from cotton3dg.plant_map.summary import summarise_map

TRUNK = 0
LINT_RED = 0.65
GAP_CM, NEIGHBOURS, FEWEST_POINTS = 0.8, 10, 200
"""Points of lint that hang together by such steps are a boll, if they are that many."""
NEAR_CM = 2.0


def read_points(path: Path) -> NDArray[np.float64]:
    """(N, 3 or more), separated by blanks or commas."""
    lines = path.read_text(encoding="utf-8").replace(",", " ").splitlines()
    return np.array([[float(cell) for cell in line.split()] for line in lines if line.strip()])


def read_plant(folder: Path, plant: str) -> tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.bool_]]:
    """(N, 3) cm, whose z points up; (N,) the branch of each, from 1, or `TRUNK`; (N,) whether it is lint."""
    trunk = read_points(folder / "treeqsm" / plant / "trunk.txt")[:, :3]
    places, owners, lint = [trunk], [np.full(len(trunk), TRUNK)], [np.zeros(len(trunk), bool)]
    files = sorted((folder / "restore" / plant).glob("*_restore.txt"), key=lambda path: int(path.stem.split("_")[0]))
    for number, path in enumerate(files, start=1):
        rows = read_points(path)
        places.append(rows[:, :3])
        owners.append(np.full(len(rows), number))
        lint.append(np.isclose(rows[:, 3], LINT_RED))
    return 100 * np.vstack(places), np.concatenate(owners), np.concatenate(lint)


def part_bolls(places_cm: NDArray, lint: NDArray[np.bool_]) -> NDArray[np.int64]:
    """(N,) boll of each point, from 1; 0 = wood, -1 = specks of lint."""
    geometry, utility = import_open3d().geometry, import_open3d().utility
    cloud = geometry.PointCloud(utility.Vector3dVector(places_cm[lint]))
    parts = np.array(cloud.cluster_dbscan(eps=GAP_CM, min_points=NEIGHBOURS))
    sizes = np.bincount(parts[parts >= 0])
    numbers = np.append(np.where(sizes >= FEWEST_POINTS, np.cumsum(sizes >= FEWEST_POINTS), -1), -1)
    bolls = np.zeros(len(places_cm), np.int64)
    bolls[lint] = numbers[parts]
    return bolls


def most_common(owners: NDArray) -> int:
    return int(np.bincount(owners).argmax())


def compare(
    plant_map: PlantMap, places_cm: NDArray, owners: NDArray, bolls: NDArray
) -> tuple[pd.DataFrame, NDArray[np.bool_]]:
    """A row for each branch at the stem, of the map or missed by it; (B,) which bolls hang on the right one.

    Args:
        places_cm: (N, 3) in the frame of the map. owners, bolls: (N,) of each place.
    """
    parents = {axis.rank: axis.parent for axis in plant_map.branches}
    first = {}
    for rank in parents:
        base = rank
        while parents[base] != 0:
            base = parents[base]
        first[rank] = base
    tree = cKDTree(places_cm[owners != TRUNK])
    passed: dict[int, list[NDArray]] = {base: [] for base in set(first.values())}
    for axis in plant_map.branches:
        away, row = tree.query(resampled(axis.curve, 0.5))
        passed[first[axis.rank]].append(owners[owners != TRUNK][row[away < NEAR_CM]])
    of_theirs, rows = {}, []
    for axis in plant_map.branches:
        if axis.parent == 0 and (own := np.concatenate(passed[axis.rank])).size:
            theirs = most_common(own)
            of_theirs[axis.rank] = theirs
            rows.append({"branch": axis.rank, "foot, cm": axis.curve[0, 2], "length, cm": length_of(axis.curve),
                         "theirs": theirs, "of its way, %": 100 * np.mean(own == theirs)})  # fmt: skip
    table = pd.DataFrame(rows)
    trunk = cKDTree(places_cm[owners == TRUNK])
    for theirs in sorted(set(owners) - {TRUNK}):
        own = places_cm[owners == theirs]
        foot_cm = own[trunk.query(own)[0].argmin(), 2]
        table.loc[table["theirs"] == theirs, "their foot, cm"] = foot_cm
        if theirs not in of_theirs.values():
            table.loc[len(table)] = {"theirs": theirs, "their foot, cm": foot_cm}
    sites = {boll.boll_id: boll.branch for boll in plant_map.bolls}
    held = [
        of_theirs.get(first.get(sites.get(boll, 0), 0)) == most_common(owners[bolls == boll])
        for boll in range(1, bolls.max() + 1)
    ]
    return table, np.array(held)


def draw(path: Path, plant_map: PlantMap, places_cm: NDArray, owners: NDArray, lint: NDArray) -> None:
    """From two sides: the points in the colours of their branches, the map in black."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, panels = pyplot.subplots(1, 2, figsize=(16, 12), sharey=True)
    for panel, axis in zip(panels, (0, 1), strict=True):
        panel.scatter(places_cm[lint, axis], places_cm[lint, 2], s=0.2, c="0.8")
        panel.scatter(places_cm[~lint, axis], places_cm[~lint, 2], s=0.3, c=owners[~lint], cmap="tab20")
        for branch in plant_map.axes:
            panel.plot(branch.curve[:, axis], branch.curve[:, 2], "k-", linewidth=1.5)
            panel.annotate(str(branch.rank), branch.curve[-1, [axis, 2]], color="red")
        panel.set_aspect("equal")
        panel.set_xlabel(f"{'xy'[axis]}, cm")
    panels[0].set_ylabel("height, cm")
    figure.tight_layout()
    figure.savefig(path, dpi=70)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    folder = parser.parse_args().folder
    for plant in sorted(path.name for path in (folder / "restore").iterdir()):
        places, owners, lint = read_plant(folder, plant)
        bolls = part_bolls(places, lint)
        known = bolls >= 0
        places, owners, lint, bolls = places[known], owners[known], lint[known], bolls[known]
        began = time.process_time()
        found = measure_cloud(places, bolls)
        seconds = time.process_time() - began
        # The map stands on the origin.
        places = places - find_foot(places, lint)
        table, held = compare(found.plant_map, places, owners, bolls)
        right = (table["of its way, %"] > 50) & ~table["theirs"].duplicated(keep=False)
        theirs, ours = len(set(owners) - {TRUNK}), int(table["branch"].notna().sum())
        traits = summarise_map(found.plant_map, 0.0, 0.0, 0.0)
        print(f"{plant}: {len(places)} points, {seconds:.1f} s of processor\n\n{markdown(table, 1)}")
        print(f"{right.sum()} of {theirs} branches at the stem one to one, of {ours} found")
        print(f"{held.sum()} of {len(held)} bolls on the right one")
        print(
            f"{traits.branch_count} branches in all, stem {traits.stem_length_cm:.1f} cm, "
            f"{traits.stem_diameter_mm:.1f} mm, internode {traits.internode_mean_cm:.1f} cm, "
            f"angle {traits.branch_angle_mean_deg:.0f} degrees"
        )
        draw(folder / f"map_{plant}.png", found.plant_map, places, owners, lint)


if __name__ == "__main__":
    main()
