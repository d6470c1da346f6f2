"""Whether the errors that a row states are as large as its true ones, as Markdown on standard output.

    python tests/accuracy/stated_errors.py RUN[:TRUTH] ...

Each RUN is a finished plant, TRUTH the folder of its truth.json if that is another. A row a plant: error and stated
standard error of count, volume, height and canopy. Then, for each trait, how often the truth lies within 1.96 stated
errors, and the root mean square of error / stated, which should be near 1: below it the program is too careful, above
it too sure. Last the figures that the constants marked "fitted" in cotton3dg/traits/error_model.py rest on, from every
second plant, to be compared with those of the others.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
import pandas as pd
from markdown_tables import markdown

from cotton3dg.documents.truth import Truth
from cotton3dg.evaluation.plant import evaluate
from cotton3dg.files.tables import parse_number, read_rows
from cotton3dg.traits.error_model import find_touching
from cotton3dg.workspace import Workspace

STATED = {
    "boll_count": "boll_count_error",
    "boll_volume_cm3": "boll_volume_error_cm3",
    "plant_height_cm": "plant_height_error_cm",
    "canopy_size_cm": "canopy_size_error_cm",
}
QUANTILE = 1.96


def judged(run: str) -> dict[str, float | str]:
    """One plant."""
    folder, _, truth = run.partition(":")
    plant = Workspace(Path(folder))
    truth_json = Path(truth or folder) / "truth.json"
    errors, matches = evaluate(plant, truth_json)
    row = read_rows(plant.traits_csv)[0]
    bolls = read_rows(plant.bolls_csv)
    places = np.array([[parse_number(boll[f"{axis}_cm"]) for axis in "xyz"] for boll in bolls]).reshape(-1, 3)
    touching = find_touching(places, np.array([parse_number(boll["diameter_cm"]) for boll in bolls]))
    result: dict[str, float | str] = {"plant": plant.root.name, "touching": int(touching.sum())}
    for error in errors:
        if error.trait in STATED:
            result[error.trait] = error.measured - error.truth
            result[f"{error.trait} stated"] = parse_number(row[STATED[error.trait]])
    result["true_volume"] = Truth.load(truth_json).total_boll_convex_volume_cm3
    result["one_boll_pct"] = float(np.median(np.abs(matches.volume_errors_pct)))
    return result


def coverage(rows: pd.DataFrame) -> pd.DataFrame:
    """For each trait, how errors compare with what was stated."""
    found = []
    for trait in STATED:
        share = (rows[trait] / rows[f"{trait} stated"]).to_numpy()
        # An error of zero stated as zero is as good as it gets.
        share = np.where((rows[trait] == 0) & (rows[f"{trait} stated"] == 0), 0.0, share)
        share = share[np.isfinite(share)]
        found.append(
            {
                "trait": trait,
                "plants": len(share),
                "within 1.96 stated, %": round(100 * float((np.abs(share) <= QUANTILE).mean()), 1),
                "rms of error / stated": round(float(np.sqrt((share**2).mean())), 2),
            }
        )
    return pd.DataFrame(found)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("runs", nargs="+", metavar="RUN[:TRUTH]")
    rows = pd.DataFrame([judged(run) for run in parser.parse_args().runs])
    print(markdown(rows.round(2)))
    for name, some in {"all": rows, "every second": rows[::2], "the others": rows[1::2]}.items():
        print(f"\n{name}\n\n{markdown(coverage(some))}")
        lost = float((some["boll_count"] ** 2).sum() / max(some["touching"].sum(), 1))
        volume = np.sqrt(((100 * some["boll_volume_cm3"] / some["true_volume"]) ** 2).mean())
        print(
            f"\nmiscounted, of those that touch: {lost:.3f}; volume of the plant: rms {volume:.1f} %; "
            f"one boll, median: {some['one_boll_pct'].median():.1f} %"
        )


if __name__ == "__main__":
    main()
