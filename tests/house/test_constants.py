# SPDX-License-Identifier: Apache-2.0
"""Constants of the package cannot be given a second value, and docs/notes/constants.md lists those that make bolls."""

import ast
import importlib
import re
import tomllib
from numbers import Real

import numpy as np
import pytest
from scenes.tiny_plant import ROOT

CONSTANT = re.compile(r"_?[A-Z][A-Z0-9_]+")
PACKAGE = ROOT / "cotton3dg"
PAGE = ROOT / "docs" / "notes" / "constants.md"
ROOMS = ("masks", "segment", "cluster")
FIRST = [f"{room}/stage" for room in ROOMS]
"""The modules that the program calls."""
CHOOSE = {"masks/backends", "segment/stage", "cluster/stage"}
"""The modules that choose by the options who does the work. No other module of the default path knows the others."""
SOURCE, TRAINING, PHOTO = "masks of another source", "training of networks", "a single photograph"
OTHERS = {
    "masks/annotated_pictures": TRAINING,
    "masks/bolls_network": TRAINING,
    "masks/bolls_training": TRAINING,
    "masks/grounding_dino": "back end grounded-sam",
    "masks/non_max_suppression": "back ends yolo, sam and grounded-sam",
    "masks/photometric_augmentation": TRAINING,
    "masks/sam": "back ends sam and grounded-sam",
    "masks/single_image": PHOTO,
    "masks/test_time_augmentation": PHOTO,
    "masks/train_yolo": TRAINING,
    "masks/transformer_models": "back ends sam and grounded-sam",
    "masks/yolo": "back end yolo",
    "masks/yolo_networks": "back end yolo",
    "segment/affinity": "segment method affinity",
    "segment/lift": SOURCE,
    "segment/probability": "segment method probability",
    "segment/probability_pictures": "segment method probability",
    "segment/prompts": "segment method affinity",
    "segment/segment": SOURCE,
    "cluster/consensus": SOURCE,
    "cluster/dbscan": "cluster method dbscan",
    "cluster/view_objects": SOURCE,
}
"""Modules of the three rooms that do not run with default options -> what they are for."""
BEYOND = {
    "core/training_picture": "the classes of pixels",
    "gaussians/plant_windows": "what the network sees",
    "geometry/planes": "where the plant begins, for these windows",
    "schemas/network_maps": "what is stored of the maps",
}
"""Modules of other rooms whose constants the page lists -> what they decide for the three rooms."""
SCORE = "cluster/same_boll.toml"
GROUPS = ("Fitted by a command", "Chosen by hand", "Numerical", "Definitions")


def final_names(source: str) -> list[str]:
    """Names that a module declares `Final`."""
    return [
        node.target.id
        for node in ast.parse(source).body
        if isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name)
        if "Final" in ast.unparse(node.annotation)
    ]


def is_numeric(value: object) -> bool:
    """Whether a value is a number or consists of numbers."""
    if isinstance(value, dict):
        value = list(value.values())
    if isinstance(value, tuple | list | set | frozenset | range | np.ndarray):
        return len(value) > 0 and all(is_numeric(item) for item in value)
    return isinstance(value, Real) and not isinstance(value, bool)


def shown(value: object) -> str:
    """A value as the page has it."""
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def numeric_constants(source: str, values: dict[str, object]) -> dict[str, str]:
    """The numeric `Final` constants of a module -> value.

    Args:
        values: of the module's names.
    """
    return {name: shown(values[name]) for name in final_names(source) if is_numeric(values[name])}


def constants_of(module: str) -> dict[str, str]:
    loaded = importlib.import_module(f"cotton3dg.{module.replace('/', '.')}")
    own = numeric_constants((PACKAGE / f"{module}.py").read_text(encoding="utf-8"), vars(loaded))
    return {f"{module}.{name}": value for name, value in own.items()}


def score_numbers(text: str) -> dict[str, str]:
    """The numbers of the fitted score -> value. Those of a term carry the name of its measure."""
    found: dict[str, str] = {}

    def walk(prefix: str, value: object) -> None:
        if isinstance(value, dict):
            for key, item in value.items():
                if key != "name":
                    walk(f"{prefix}{'.' if prefix else ''}{key}", item)
        elif isinstance(value, list):
            for item in value:
                walk(item["name"], {key: part for key, part in item.items() if key != "name"})
        else:
            found[f"{SCORE} {prefix}"] = shown(value)

    walk("", tomllib.loads(text))
    return found


def imported_by(module: str, source: str) -> set[str]:
    """The package's modules that a module imports, also inside of functions."""
    found, folder = set(), module.split("/")[:-1]
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.ImportFrom) and node.level:
            start = [*folder[: len(folder) + 1 - node.level], *(node.module or "").split(".")]
            place = "/".join(part for part in start if part)
            found |= {place, *(f"{place}/{item.name}" for item in node.names)}
    return {name for name in found if (PACKAGE / f"{name}.py").is_file()}


def default_path() -> dict[str, set[str]]:
    """The modules that the three stages reach without the `OTHERS` -> what each imports."""
    reached: dict[str, set[str]] = {}
    waiting = list(FIRST)
    while waiting:
        module = waiting.pop()
        if module not in reached and module not in OTHERS:
            reached[module] = imported_by(module, (PACKAGE / f"{module}.py").read_text(encoding="utf-8"))
            waiting += sorted(reached[module])
    return reached


def in_rooms(modules) -> set[str]:
    return {module for module in modules if module.split("/")[0] in ROOMS}


def sections(page: str) -> dict[str, str]:
    """Title -> text of each section."""
    parts = re.split(r"^## (.*)\n", page, flags=re.M)
    return dict(zip(parts[1::2], parts[2::2], strict=True))


def rows(text: str) -> list[tuple[str, str, str]]:
    """Constant, value and last cell of each row of a table of constants."""
    found = re.findall(r"^\| `([^`]+)` \| ([^|]+?) \| [^|]+ \| ([^|]+?) \|$", text, re.M)
    return [(name, value, last) for name, value, last in found]


def plain_constants(source: str) -> list[str]:
    """Names of the module's constants that are not `Final`, so that mypy lets them be assigned again."""
    found = []
    for node in ast.parse(source).body:
        if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name):
            found.append(node.targets[0].id)
        if isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
            found += [] if "Final" in ast.unparse(node.annotation) else [node.target.id]
    return [name for name in found if CONSTANT.fullmatch(name)]


def test_what_counts_as_plain():
    assert plain_constants("A_B = 1\n_C_D: int = 2\nD: Final = 3\nE: Final[int] = 4\nlog = 5\nKind = 6") == [
        "A_B",
        "_C_D",
    ]


def test_constants_are_final():
    plain = {path: plain_constants(path.read_text(encoding="utf-8")) for path in (ROOT / "cotton3dg").rglob("*.py")}
    assert len(plain) > 300
    assert {path.name: names for path, names in plain.items() if names} == {}


def test_what_counts_as_numeric():
    source = (
        "from typing import Final\nA: Final = 1_000\n_B: Final[float] = 1 - 2.5**-2\nC: Final = range(-2, 4)\n"
        "D: Final = ('a', 'b')\nE: Final = len(D) + 4\nF: Final = True\nG = 3\nH: Final = {'x': 1e-6}\n"
        "I: Final = (1, 'a')"
    )
    values: dict[str, object] = {}
    exec(source, values)
    expected = {"A": "1000", "_B": "0.84", "C": "range(-2, 4)", "E": "6", "H": "{'x': 1e-06}"}
    assert numeric_constants(source, values) == expected
    values["A"] = 1001
    assert numeric_constants(source, values) != expected


def test_what_counts_of_the_score():
    text = 'constant = -1.5\nterms = [{ name = "a_cm", usual = 4.0, weight = -0.7 }]\none = { slope = 0.6 }'
    names = {"constant": "-1.5", "a_cm.usual": "4", "a_cm.weight": "-0.7", "one.slope": "0.6"}
    assert score_numbers(text) == {f"{SCORE} {name}": value for name, value in names.items()}


def test_what_counts_as_imported():
    source = "from ..core.scene import Camera\nfrom .bolls import SURE\ndef f():\n    from . import sam\n    import cv2"
    assert imported_by("masks/stage", source) == {"core/scene", "masks/bolls", "masks/sam"}


def test_each_module_of_the_three_rooms_is_on_the_default_path_or_among_the_others():
    there = {f"{room}/{path.stem}" for room in ROOMS for path in (PACKAGE / room).glob("*.py")}
    there -= {f"{room}/__init__" for room in ROOMS}
    path = default_path()
    assert in_rooms(path) | OTHERS.keys() == there
    assert {module for module, imported in path.items() if imported & OTHERS.keys()} == CHOOSE
    assert path.keys() >= BEYOND.keys()


def test_the_page_names_the_modules_of_the_default_path():
    named = re.findall(r"`(\w+/\w+)`", sections(PAGE.read_text(encoding="utf-8"))["Modules"])
    assert sorted(named) == sorted(in_rooms(default_path()) | BEYOND.keys())


def test_the_page_lists_each_constant_with_its_value():
    listed = rows(PAGE.read_text(encoding="utf-8"))
    present = score_numbers((PACKAGE / SCORE).read_text(encoding="utf-8"))
    for module in in_rooms(default_path()) | BEYOND.keys():
        present |= constants_of(module)
    assert {name: value for name, value, _ in listed} == present
    assert len(listed) == len(present)


def test_the_page_counts_its_constants():
    page = PAGE.read_text(encoding="utf-8")
    counts = {title: len(rows(text)) for title, text in sections(page).items() if title in GROUPS}
    assert dict(re.findall(r"^\| \[([^\]]+)\]\(#[\w-]+\) \| (\d+) \|$", page, re.M)) == {
        title.lower(): str(count) for title, count in counts.items()
    }
    by_hand = rows(sections(page)["Chosen by hand"])
    unknown = sum(last.startswith("unknown") for _, _, last in by_hand)
    answer = page.split("\n| group")[0]
    stated = [sum(counts.values()), counts["Fitted by a command"], len(by_hand), unknown]
    assert [int(number) for number in re.findall(r"\b\d+\b", answer.replace("cotton3dg", ""))] == stated
    beside = sections(page)["Not on this path"]
    assert int(re.findall(r"\d+", beside)[0]) == len(rows(beside))


@pytest.mark.parametrize("change", ["| 0.12 |", "`cluster/hough_voting.SPREAD`"])
def test_a_row_that_is_wrong_or_lacking_is_noticed(change):
    page = PAGE.read_text(encoding="utf-8")
    own = constants_of("cluster/hough_voting")
    for text, right in ((page, True), (page.replace(change, "| 1 |" if "|" in change else "SPREAD"), False)):
        listed = {name: value for name, value, _ in rows(text) if name.startswith("cluster/hough_voting.")}
        assert (listed == own) == right
