# SPDX-License-Identifier: Apache-2.0
"""The commands of README and docs, run as written in a folder that holds what they name, on one tiny plant."""

import re
import shlex
import shutil

import numpy as np
import pytest
from scenes import doc_commands, torchvision_stand_in
from scenes.doc_commands import blocks
from scenes.onnx_scene import SIDE, write_bright_cells
from scenes.tiny_plant import FILM, OPTIONS, ROOT, in_shell
from typer.testing import CliRunner

from cotton3dg.cli.app import app
from cotton3dg.io.ply import read_gaussians
from cotton3dg.workspace import Workspace

PAGES = {str(page.relative_to(ROOT)): page for page in doc_commands.PAGES}

# Part of a command -> what is added to it here, to be done in seconds.
SHORTER = {
    "study": "--time-budget 15s",  # the base setting alone took 9 s on a busy machine
    "simulate": " ".join(f"--{name.replace('_', '-')} {value}" for name, value in FILM.items()),
    "best.onnx": f"--image-size {SIDE} --tile 96",
    "best.pt": "--image-size 160",
    "train plant_017 --max-side": "--max-side 384",  # as before: the lines that follow need traits of this model
    "masks-train model": "--image-size 160 --epochs 1 --batch 4",
    "masks-train mine": "--steps 2 --batch 2",
}
# Part of a line -> what else runs it.
ELSEWHERE = {
    "--engine slurm": "make slurm-test",
    "examples/slurm_array.sh": "make slurm-test",
    "pip install 'cotton3dg[slurm]'": "make setup, by way of [dev]",
    "pip install -e '.[sam]'": "make setup, by way of [dev]",
    "pip install -e '.[stats]'": "make setup, by way of [dev]",
    "pip install -e '.[training]'": "make bolls-network",
    "pip install -e '.[yolo]'": "make yolo-test",
    "sudo apt-get": "make bare-test",
    "git clone": "make bare-test",
    "python3 -m venv": "make bare-test BY=wheel",
    "cotton3dg/bin/cotton3dg demo": "make bare-test BY=wheel",
    "docker": "by hand; make bare-test BY=wheel does the same without a container",
    "apptainer": "by hand: it is in no stable Debian",
    "export PIP": "make bare-test",
    "source .venv": "make bare-test",
    "make setup": "make bare-test",
    "make demo": "make bare-test",
    "make test": ".ci/run",
    "make lint": ".ci/run",
    "make clean": "test_make_clean_leaves_the_sources",
    "make study-set": "test_accuracy_tools.py",
    "study_set.py": "test_accuracy_tools.py",
    "map_surfaces.py": "test_accuracy_tools.py",
    "make interval-coverage": "test_accuracy_tools.py",
    "processors.py": "test_accuracy_tools.py",
    "make segmentation-sweep": "test_accuracy_tools.py",
    "make error-budget": "test_accuracy_tools.py",
    "make bolls-network": "test_bolls_backend.py",
    "effect_decisions.py": "test_accuracy_tools.py",
    "mkdir plant_017": "examples/one_plant.sh in test_examples.py",
    "cotton3dg check walk.mp4": "test_check.py",
    "for film in today": "test_check.py",
    "cotton3dg compare": "test_two_films.py",
    "cotton3dg correct": "test_corrections.py",
    "cotton3dg view": "test_view.py",
    "evaluate-weights": "evaluation/test_weights.py",
    "--weight-model": "evaluation/test_weights.py",
    "real_captures.py": "test_accuracy_tools.py",
    "hard_walks.py": "test_accuracy_tools.py, that it starts",
    "--architecture natural": "simulate/test_architecture.py",
    "splat.ply": "test_foreign_models.py",
    "cotton3dg cards": "commands/test_cards.py",
    "cotton3dg import": "commands/test_import_.py",
    "cotton3dg repeat": "test_two_films.py",
    "cotton3dg export": "commands/test_export.py",
    "--preset paper": "test_segment_methods.py and test_scale_methods.py",
    "preset=standard,paper1,paper2": "study/test_settings.py",
    "train.start=dense": "study/test_settings.py",
    "--lpips": "study/test_lpips.py",
}
YOLO = ("best.pt", "--network yolo")


def lines(page):
    """Lines of shell in a page, without comments."""
    shown = [block.lines for block in blocks(page) if block.language not in ("python", "text", "toml")]
    bare = [re.sub(r"(^|\s)#.*", "", line).strip() for block in shown for line in block]
    return [line for line in bare if line]


def is_elsewhere(line):
    return any(part in line for part in ELSEWHERE)


def runnable(page):
    """Lines of a page to run here that no page before it has."""
    before = [line for other in PAGES.values() if other < page for line in lines(other)]
    return [line for line in dict.fromkeys(lines(page)) if line not in before and not is_elsewhere(line)]


CHOICES = "choices_of_the_first_run.json"


@pytest.fixture(scope="module")
def desk(first_run, tmp_path_factory):
    """The folder that the pages speak of."""
    folder = tmp_path_factory.mktemp("desk")
    for name in ("plant_017", "plain-2", "plain-a", "some_folder", "field_2026/plant_001", "field_2026/plant_017"):
        shutil.copytree(first_run[0].root, folder / name)
    (folder / "cotton3dg.toml").write_text(OPTIONS)
    plant = Workspace(folder / "plant_017")
    shutil.copyfile(plant.choices_json, folder / CHOICES)
    shutil.copytree(plant.folder("masks"), folder / "drawn")
    (folder / "drawn" / "masks.json").unlink()
    shutil.copyfile(ROOT / "examples" / "truth.csv", folder / "lidar.csv")
    shutil.copyfile(plant.bolls_csv, folder / "true_bolls.csv")
    images = sorted(path.name for path in plant.frame_images())[:3]
    picks = [row for image in images for row in (f"a,{image},100,120", f"b,{image},220,120")]
    plant.scale_points.write_text("\n".join(["point,image,x_px,y_px", *picks, ""]))
    clicks = [f"{image.partition('.')[0]},160,60" for image in images]
    (folder / "clicks.csv").write_text("\n".join(["image,x,y", *clicks, ""]))
    write_bright_cells(folder / "best.onnx")
    means = read_gaussians(plant.gaussians_ply).means
    header = ["ply", "format ascii 1.0", f"element vertex {len(means)}"]
    header += [*(f"property float {axis}" for axis in "xyz"), "end_header"]
    np.savetxt(folder / "scan.ply", means, header="\n".join(header), comments="")
    return folder


def forget_choices(folder):
    """Let the next line find the plant as it was made: what a line chooses would stay chosen in those after it."""
    shutil.copyfile(folder / CHOICES, Workspace(folder / "plant_017").choices_json)


def run(line, folder):
    """Run a line, in this process where it is one command of the tool."""
    forget_choices(folder)
    if not line.startswith("cotton3dg "):
        done = in_shell("bash", "-c", line, cwd=folder)
        assert done.returncode == 0, f"{line}\n{done.stderr}"
        return
    words = [*shlex.split(line)[1:], *(word for part, more in SHORTER.items() if part in line for word in more.split())]
    result = CliRunner().invoke(app, words)
    assert result.exit_code == 0, f"{line}\n{result.output}\n{result.exception!r}"


@pytest.mark.parametrize("name", PAGES)
def test_the_commands_of_a_page_work(name, desk, monkeypatch, tmp_path):
    monkeypatch.chdir(desk)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    here = runnable(PAGES[name])
    if any("--backend" in line and "sam" in line for line in here):
        pytest.importorskip("transformers")
        from scenes.transformer_scene import save

        for folder, kind in (("sam-vit-base", "sam"), ("sam2.1-hiera-small", "sam2")):
            save(desk / folder, kind)
        save(desk / "grounding-dino-tiny", "grounding-dino")
    for line in here:
        if not any(part in line for part in YOLO):
            run(line, desk)


def test_yolo_models_are_trained_and_used(desk, monkeypatch):
    """In an environment with ultralytics: make yolo-test."""
    ultralytics = pytest.importorskip("ultralytics")
    torchvision_stand_in.provide()
    monkeypatch.chdir(desk)
    run("cotton3dg masks plant_017", desk)
    run("cotton3dg masks-export plant_017", desk)
    ultralytics.YOLO("yolo11n-seg.yaml").save(desk / "yolo11x-seg.pt")
    ours = [line for page in PAGES.values() for line in lines(page) if any(part in line for part in YOLO)]
    training, use = sorted(ours, key=lambda line: "masks-train" not in line)
    run(training, desk)
    shutil.copyfile(desk / "model" / "best.pt", desk / "best.pt")
    run(use, desk)
    assert (desk / "model" / "best.onnx").is_file()


@pytest.mark.parametrize("name", PAGES)
def test_the_python_of_a_page_works(name, desk, monkeypatch):
    monkeypatch.chdir(desk)
    forget_choices(desk)
    names: dict[str, object] = {}
    for block in blocks(PAGES[name]):
        if block.language == "python":
            exec("\n".join(block.lines), names)


def test_every_line_is_run_by_something():
    every = [line for page in PAGES.values() for line in lines(page)]
    assert sum(not is_elsewhere(line) for line in every) > 50
    assert {part for part in ELSEWHERE if not any(part in line for line in every)} == set()
    targets = (ROOT / "Makefile").read_text()
    for where in ELSEWHERE.values():
        assert not where.startswith("make ") or f"\n{where.split()[1].rstrip(',')}:" in targets, where


def test_make_clean_leaves_the_sources(tmp_path):
    for name in (".venv/bin", "build/native", "demo", "results", "cotton3dg", "native"):
        (tmp_path / name).mkdir(parents=True)
    shutil.copyfile(ROOT / "Makefile", tmp_path / "Makefile")
    assert in_shell("make", "clean", cwd=tmp_path).returncode == 0
    assert {path.name for path in tmp_path.iterdir()} == {"Makefile", "cotton3dg", "native"}
