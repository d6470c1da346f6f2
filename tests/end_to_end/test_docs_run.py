"""The commands of README and docs, run as written in a folder that holds what they name, on one tiny plant."""

import shutil

import doc_commands
import numpy as np
import pytest
from doc_commands import blocks, commands
from tiny_plant import ROOT
from typer.testing import CliRunner

from cotton3dg.cli import app
from cotton3dg.files.ply import read_gaussians
from cotton3dg.workspace import Workspace

NOT_RUN = {
    "--backend yolo": "needs weights; test_mask_backends.py makes small ones",
    "--backend sam": "needs weights; test_mask_backends.py makes small ones",
    "--backend grounded-sam": "needs weights; test_mask_backends.py makes small ones",
    "masks-train": "needs ultralytics",
    "--time-budget": "measures the machine; test_study_run.py does it",
    " study ": "trains many times; test_study_run.py does it",
    "--engine slurm": "needs a cluster; make slurm-test starts one",
    "$plant": "a loop; test_examples.py runs one",
    "simulate": "takes longer than the rest; this plant was made by it",
}
PAGES = [str(page.relative_to(ROOT)) for page in doc_commands.PAGES]


def runnable():
    """(page, command) of all pages in order, each command once."""
    first_on: dict[tuple[str, ...], str] = {}
    for page in PAGES:
        for block in blocks(ROOT / page):
            for words in commands(block.lines, ("cotton3dg",)) if block.language != "python" else ():
                first_on.setdefault(tuple(words), page)
    return [
        (page, command) for command, page in first_on.items() if not any(why in " ".join(command) for why in NOT_RUN)
    ]


@pytest.fixture(scope="module")
def desk(first_run, tmp_path_factory):
    """The folder that the pages speak of."""
    folder = tmp_path_factory.mktemp("desk")
    for name in ("plant_017", "demo_plant", "field_2026/plant_001", "field_2026/plant_017"):
        shutil.copytree(first_run[0].root, folder / name)
    plant = Workspace(folder / "plant_017")
    shutil.copytree(plant.folder("masks"), folder / "drawn")
    (folder / "drawn" / "masks.json").unlink()
    shutil.copyfile(ROOT / "examples" / "truth.csv", folder / "lidar.csv")
    images = sorted(path.name for path in plant.frame_images())[:3]
    picks = [row for image in images for row in (f"a,{image},100,120", f"b,{image},220,120")]
    plant.scale_points.write_text("\n".join(["point,image,x_px,y_px", *picks, ""]))
    means = read_gaussians(plant.gaussians_ply).means
    header = ["ply", "format ascii 1.0", f"element vertex {len(means)}"]
    header += [*(f"property float {axis}" for axis in "xyz"), "end_header"]
    np.savetxt(folder / "scan.ply", means, header="\n".join(header), comments="")
    return folder


@pytest.mark.parametrize("page", PAGES)
def test_the_commands_of_a_page_work(page, desk, monkeypatch, tmp_path):
    monkeypatch.chdir(desk)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    for command in [command for where, command in runnable() if where == page]:
        result = CliRunner().invoke(app, list(command[1:]))
        assert result.exit_code == 0, f"{' '.join(command)}\n{result.output}\n{result.exception!r}"


def test_most_commands_are_run():
    assert len(runnable()) > 35
