# SPDX-License-Identifier: Apache-2.0
"""Every script in examples/ does what it says, on one tiny plant."""

import csv
import json
import runpy
import shutil
from pathlib import Path

import nbformat
import pytest
from nbclient import NotebookClient
from scenes.tiny_plant import FILM, ROOT, in_shell

from cotton3dg.choices import read_toml
from cotton3dg.io.images import read_image
from cotton3dg.io.tables import TRAITS
from cotton3dg.option_rules import as_dict
from cotton3dg.options import SimulateOptions, resolve

EXAMPLES = ROOT / "examples"


def rows(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


@pytest.fixture
def plants(tiny_plant, tmp_path):
    """A folder with the finished plant and one without a video."""
    (tmp_path / "field" / "empty").mkdir(parents=True)
    shutil.move(tiny_plant.root, tmp_path / "field" / "plant_017")
    return tmp_path / "field"


def test_each_has_a_test():
    text = Path(__file__).read_text()
    made_elsewhere = {"slurm_array.sh"}
    assert {path.name for path in EXAMPLES.iterdir() if path.is_file()} - made_elsewhere <= {
        name for name in text.split('"') if "." in name
    } | {"one_plant.sh"}


def test_one_plant(first_run):
    plant, said = first_run
    (row,) = rows(plant.traits_csv)
    assert row["plant_id"] == "plant_017"
    truth = json.loads((plant.root / "truth.json").read_text())
    assert int(row["boll_count"]) == truth["boll_count"] == FILM["bolls"]
    assert float(row["plant_height_cm"]) == pytest.approx(truth["plant_height_cm"], rel=0.05)
    assert f"look at {plant.root}/report.html" in said
    assert plant.report_html.is_file()


def test_many_plants(plants, first_run):
    done = in_shell(EXAMPLES / "many_plants.sh", plants, plants / "all.csv", cwd=plants)
    assert done.returncode == 1
    assert "1 plants failed" in done.stdout
    assert rows(plants / "all.csv") == rows(first_run[0].traits_csv)


def test_own_coco_masks(tiny_plant, tmp_path):
    before = rows(tiny_plant.traits_csv)
    assert in_shell("cotton3dg", "masks-export", tiny_plant.root, cwd=tmp_path).returncode == 0
    document = json.loads(tiny_plant.annotations_json.read_text())
    fewer = document | {"annotations": [item for item in document["annotations"] if item["bbox"][1] > 60]}
    assert 0 < len(fewer["annotations"]) < len(document["annotations"])
    (tmp_path / "corrected.json").write_text(json.dumps(fewer))
    done = in_shell(EXAMPLES / "own_coco_masks.sh", "plant_017", "corrected.json", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert rows(tiny_plant.root / "traits_of_found_masks.csv") == before
    assert json.loads(tiny_plant.masks_json.read_text())["backend"] == "import"
    assert int(rows(tiny_plant.traits_csv)[0]["boll_count"]) < int(before[0]["boll_count"])


def test_against_truth(plants, tmp_path):
    header, first, *_ = (EXAMPLES / "truth.csv").read_text().splitlines()
    (tmp_path / "truth.csv").write_text(f"{header}\n{first}\n")
    done = in_shell(EXAMPLES / "against_truth.sh", plants, "truth.csv", "scores", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "empty: failed: no video" in done.stdout
    scores = {row["trait"]: row for row in rows(tmp_path / "scores" / "evaluation.csv")}
    assert list(scores) == [name for name in header.split(",")[1:] if name != "boll_weight_g"]
    measured = float(rows(plants / "plant_017" / "traits" / "traits.csv")[0]["plant_height_cm"])
    true = float(dict(zip(header.split(","), first.split(","), strict=True))["plant_height_cm"])
    assert float(scores["plant_height_cm"]["bias"]) == pytest.approx(measured - true, abs=0.01)
    assert (tmp_path / "scores" / "scatter_plant_height_cm.png").is_file()


def test_the_truth_names_columns_of_the_table():
    names = {column.name for column in TRAITS} | {"boll_weight_g"}
    assert set((EXAMPLES / "truth.csv").read_text().splitlines()[0].split(",")) <= names


def test_the_functions_of_python_give_what_a_run_gives(tiny_plant, tmp_path):
    # The example masks as many images as a run does by default; the tiny plant's own options say fewer.
    options = tiny_plant.options_file.read_text()
    tiny_plant.options_file.write_text(options.replace("views = 16", "views = 36"))
    assert tiny_plant.options_file.read_text() != options
    done = in_shell("python", EXAMPLES / "python_api.py", tiny_plant.root, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    last = done.stdout.splitlines()[-1].split()
    (row,) = rows(tiny_plant.traits_csv)
    assert last[0] == row["boll_count"]
    # `cluster` rounds the length of a scene unit, and `masks` stores probabilities in 255 steps.
    assert float(last[3]) == pytest.approx(float(row["boll_volume_cm3"]), rel=0.01)
    assert float(last[5]) == pytest.approx(float(row["plant_height_cm"]), abs=0.06)


def test_tutorial(tiny_plant, tmp_path):
    notebook = nbformat.read(EXAMPLES / "tutorial.ipynb", as_version=4)
    assert not any(cell.get("outputs") for cell in notebook.cells)
    (first, *_) = (cell for cell in notebook.cells if cell.cell_type == "code")
    assert 'measure("demo")' in first.source
    first.source = first.source.replace("demo", str(tiny_plant.root))
    NotebookClient(notebook, timeout=300, resources={"metadata": {"path": str(tmp_path)}}).execute()
    shown = [output.data for cell in notebook.cells for output in cell.get("outputs", []) if "data" in output]
    assert sum("image/png" in data for data in shown) == 3
    (row,) = rows(tiny_plant.traits_csv)
    (result,) = (data["text/html"] for data in shown if "report.html" in data.get("text/html", ""))
    assert 'src="data:image/jpeg' in result
    tables = "".join(data["text/plain"] for data in shown)
    for trait in ("plant_height_cm", "plant_height_low_cm", "canopy_size_cm"):
        assert f"{float(row[trait]):.1f}" in result
        assert f"{float(row[trait]):.1f}" in tables
    assert f"{float(row['boll_volume_cm3']):.2f}" in tables  # beside the truth


def test_picture(tiny_plant, tmp_path):
    done = in_shell("python", EXAMPLES / "picture.py", tiny_plant.root, tmp_path / "picture.jpg", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    height, width, _ = read_image(tmp_path / "picture.jpg").shape
    assert height == pytest.approx(width * 9 / 16, abs=4)


def test_filming_pictures():
    example = runpy.run_path(str(EXAMPLES / "filming_pictures.py"))
    options = SimulateOptions(seed=11, bolls=2, frames=40, width=96, height=54)
    name, picture = next(example["pictures"](options))
    assert name == "good"
    assert picture.shape == (54, 96, 3)
    assert picture.std() > 10
    assert (example["walk"](360) < 100).sum() > (example["walk"](190) < 100).sum()


def test_options_file():
    values = read_toml(EXAMPLES / "cotton3dg.toml")
    assert len(values) == 5
    options = {stage: as_dict(resolve(stage, of_stage)) for stage, of_stage in values.items()}
    assert options["frames"]["count"] == 100
    assert values["segment"] == {"probability": {"threshold": 0.9}}
    assert (options["scale"]["table_length_cm"], options["scale"]["table_width_cm"]) == (120, 60)
    assert options["traits"]["plant_id"] == "GH-07-plot-3"
