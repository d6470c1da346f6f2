"""Fifty videos without names, from the phone's folder to the export: whose rows come out, and what is in doubt.

    python tests/accuracy/fifty_videos.py FOLDER [--seed 0]

36 ordinary films of cards; 10 soiled, tilted, half covered or blurred; two with the same id; two without a card.
`import` reads them and `export` writes them. Between the two, `batch` runs a stand-in for `cotton3dg run` that measures
nothing and writes a row with the id under which the plant's own run would write it: no model is trained here.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from pathlib import Path

import numpy as np
from scenes.card_scene import card_sheet, film_card

from cotton3dg.batch import Batch, find_plants
from cotton3dg.commands.export import FORMATS, export
from cotton3dg.commands.import_videos import DOUBT, IMPORTED, Import, import_videos
from cotton3dg.files.tables import read_rows

STAND_IN = """
import sys
from pathlib import Path
from cotton3dg.core.measurements import PlantTraits
from cotton3dg.core.columns import columns_of
from cotton3dg.files.tables import BOLLS, TRAITS, csv_text
from cotton3dg.pipeline import stage_options
from cotton3dg.workspace import Workspace
plant = Workspace(Path(sys.argv[1]))
row = dict.fromkeys((column.name for column in TRAITS)) | {"seconds": 1.0, "version": "stand-in"}
row |= {column.name: 3 if column.digits is None else 2.5 for column in columns_of(PlantTraits)}
row |= {"plant_id": stage_options(plant)["traits"].plant_id}
(plant.root / "traits").mkdir(exist_ok=True)
plant.traits_csv.write_text(csv_text(TRAITS, [row]), newline="")
plant.bolls_csv.write_text(csv_text(BOLLS, []), newline="")
"""
HARD = (
    {"dirt": 0.06}, {"dirt": 0.1}, {"tilt_deg": 68.0}, {"tilt_deg": 74.0}, {"hidden": 0.1}, {"hidden": 0.5},
    {"blur_px": 2.5}, {"motion_px": 9.0}, {"dirt": 0.05, "tilt_deg": 65.0}, {"noise": 14.0, "light": (0.08, 0.3)},
)  # fmt: skip


def film(folder: Path, seed: int) -> dict[str, str]:
    """Make the videos; name -> true id, empty of those without a card."""
    rng = np.random.default_rng(seed)
    truth = {}
    for number in range(50):
        plant_id = f"NC26-{100 + number}" if number != 47 else "NC26-146"
        how = HARD[number - 36] if 36 <= number < 46 else {}
        has_card = number < 48
        name = f"VID_20261123_{number:06d}.mp4"
        film_card(
            folder / name, card_sheet(plant_id, 20) if has_card else None, n_frames=8, fps=2.0, size=(960, 540),
            code_px=float(rng.uniform(80, 120)), seed=seed + number, **how,
        )  # fmt: skip
        truth[name] = plant_id if has_card else ""
    return truth


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    phone, field = arguments.folder / "DCIM", arguments.folder / "field"
    phone.mkdir(parents=True)
    truth = film(phone, arguments.seed)
    book = arguments.folder / "fieldbook.csv"
    ids = sorted({plant_id for plant_id in truth.values() if plant_id})
    book.write_text("plant_id,genotype,block\n" + "".join(f"{i},G{k % 12},{k % 4}\n" for k, i in enumerate(ids)))
    began = time.process_time()
    rows = import_videos([phone], Import(field, book, how="link"))
    seconds = time.process_time() - began
    wrong = [row for row in rows if row.plant_id and row.plant_id != truth[Path(row.file).name]]
    doubts = [row for row in rows if row.state == DOUBT]
    script = arguments.folder / "stand_in.py"
    script.write_text(STAND_IN)
    Batch(field, jobs=1, command=[sys.executable, str(script)], tell=lambda text: None).run(find_plants(field))
    for kind in FORMATS:
        export(field, kind)
    table = {row["plant_id"]: row for row in read_rows(field / "batch.csv")}
    units = json.loads((field / "export" / "brapi" / "observationunits.json").read_text())["result"]["data"]
    imported = {row.plant_id for row in rows if row.state == IMPORTED}
    assert set(table) == imported == {unit["observationUnitDbId"] for unit in units}
    assert all(row["genotype"] for row in table.values())
    for row in doubts:
        print(f"{Path(row.file).name} ({truth[Path(row.file).name] or 'no card'}): {row.reason}")
    print(f"{len(rows)} videos: {len(imported)} rows, {len(doubts)} doubts, {len(wrong)} wrong; {seconds:.0f} s of CPU")


if __name__ == "__main__":
    main()
