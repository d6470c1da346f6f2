# SPDX-License-Identifier: Apache-2.0
"""Fifty videos without names, from the phone's folder to the export: whose rows come out, and what is in doubt.

    python tests/accuracy/fifty_videos.py FOLDER [--seed 0]        (some 40 CPU-minutes)

Each begins with a second of a card and goes on with a walk around one of five simulated plants. 36 are ordinary; in 10
the card is soiled, tilted, half covered or blurred; two show the same id; two have no card. The commands of
docs/field.md, with a field book: `import` reads them, `batch` measures them with small models, `export` writes each
format. Prints the doubts and the counts of the plants. An id that is wrong, a row of another plant, a plant that is not
imported without being listed or without a row, or an export that lacks one ends it with an error.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pandas as pd

sys.path.insert(0, str(Path(__file__).parents[1]))

from scenes.card_scene import card_sheet, film_card

from cotton3dg.commands.export import FORMATS
from cotton3dg.commands.import_ import DOUBT, IMPORTED
from cotton3dg.commands.simulate import film_once
from cotton3dg.errors import SOME_FAILED
from cotton3dg.io.tables import read_rows
from cotton3dg.io.video import ffmpeg_binary
from cotton3dg.options import resolve
from cotton3dg.schemas.truth import Truth

SIZE = (640, 360)
WALK = {"frames": 75, "width": SIZE[0], "height": SIZE[1], "supersampling": 1, "mask_interval": 75}
BOLLS = (4, 6, 8, 10, 12)
"""Of the five plants; a row of another's film would have another count."""
SMALL = {
    "frames.count": 40, "sfm.max_features": 1024, "train.steps": 300, "train.max_side": 480,
    "train.max_gaussians": 15_000, "masks.views": 16,
}  # fmt: skip
"""Options of the batch: minutes for all fifty, and models that still show each boll."""
HARD = (
    {"dirt": 0.06}, {"dirt": 0.1}, {"tilt_deg": 68.0}, {"tilt_deg": 74.0}, {"hidden": 0.1}, {"hidden": 0.5},
    {"blur_px": 2.5}, {"motion_px": 9.0}, {"dirt": 0.05, "tilt_deg": 65.0}, {"noise": 14.0, "light": (0.08, 0.3)},
)  # fmt: skip


def film_walks(folder: Path, seed: int) -> list[Path]:
    """The five plants."""
    plants = [folder / f"{bolls}_bolls" for bolls in BOLLS]
    for plant, bolls in zip(plants, BOLLS, strict=True):
        film_once(plant, resolve("simulate", WALK | {"seed": seed + bolls, "bolls": bolls}))
    return plants


def film(folder: Path, walks: list[Path], seed: int) -> dict[str, tuple[str, int]]:
    """Make the videos; name -> true id, empty of those without a card, and which of the walks it shows."""
    rng = np.random.default_rng(seed)
    truth = {}
    for number in range(50):
        plant_id = f"NC26-{100 + number}" if number != 47 else "NC26-146"
        how = HARD[number - 36] if 36 <= number < 46 else {}
        has_card = number < 48
        name = f"VID_20261123_{number:06d}.mp4"
        walk = int(rng.integers(len(walks)))
        card = film_card(
            folder.parent / "card.mp4", card_sheet(plant_id, 20) if has_card else None, n_frames=30, fps=30.0,
            size=SIZE, code_px=float(rng.uniform(80, 120)), seed=seed + number, **how,
        )  # fmt: skip
        # Each film has noise of its own, so that no two are the same file.
        noise = f"[0:v][1:v]concat=n=2:v=1,noise=all_seed={number + 1}:alls=3:allf=t+u"
        command = [ffmpeg_binary(), "-v", "error", "-nostdin", "-i", card, "-i", walks[walk] / "video.mp4"]
        subprocess.run([*command, "-filter_complex", noise, "-crf", "14", "-an", folder / name], check=True)
        truth[name] = plant_id if has_card else "", walk
    return truth


def call(*words: str | Path, codes: tuple[int, ...] = (0, SOME_FAILED)) -> None:
    """A command of the command line; with doubts or failures it goes on."""
    done = subprocess.run([sys.executable, "-m", "cotton3dg.cli", *map(str, words)], check=False)
    if done.returncode not in codes:
        sys.exit(f"{words[0]}: exit code {done.returncode}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    phone, field = arguments.folder / "DCIM", arguments.folder / "field"
    phone.mkdir(parents=True)
    walks = film_walks(arguments.folder / "walks", arguments.seed)
    truth = film(phone, walks, arguments.seed)
    book = arguments.folder / "fieldbook.csv"
    ids = sorted({plant_id for plant_id, _ in truth.values() if plant_id})
    book.write_text("plant_id,genotype,block\n" + "".join(f"{i},G{k % 12},{k % 4}\n" for k, i in enumerate(ids)))
    began = time.monotonic()
    call("import", phone, "--into", field, "--fieldbook", book, "--how", "link")
    options = [word for key, value in SMALL.items() for word in ("--set", f"{key}={value}")]
    call("batch", field, "--jobs", "2", "--no-report", *options)
    for kind in FORMATS:
        call("export", field, "--format", kind, codes=(0,))
    minutes = (time.monotonic() - began) / 60

    imported = read_rows(field / "import.csv")
    doubts = [row for row in imported if row["state"] == DOUBT]
    shown = {row["plant_id"]: truth[Path(row["file"]).name] for row in imported if row["state"] == IMPORTED}
    rows = {row["plant_id"]: row for row in read_rows(field / "batch.csv")}
    units = json.loads((field / "export" / "brapi" / "observationunits.json").read_text())["result"]["data"]
    wrong = [plant_id for plant_id, (true_id, _) in shown.items() if plant_id != true_id]
    assert len(imported) == 50 and len(shown) + len(doubts) == 50, "a video is neither a plant nor a doubt"
    assert set(rows) == set(shown) == {unit["observationUnitDbId"] for unit in units}, "rows and plants differ"
    assert all(row["genotype"] for row in rows.values()), "a row without its genotype"
    for row in doubts:
        print(f"{Path(row['file']).name} ({truth[Path(row['file']).name][0] or 'no card'}): {row['reason']}")
    true_counts = [Truth.load(walk / "truth.json").boll_count for walk in walks]
    counts = pd.DataFrame(
        {"true": true_counts[walk], "counted": rows[plant_id]["boll_count"], "state": rows[plant_id]["state"]}
        for plant_id, (_, walk) in shown.items()
    )
    print(counts.value_counts(dropna=False).sort_index().to_string())
    print(f"50 videos: {len(shown)} rows, {len(doubts)} doubts, {len(wrong)} wrong; {minutes:.0f} minutes")
    sys.exit(bool(wrong))


if __name__ == "__main__":
    main()
