# SPDX-License-Identifier: Apache-2.0
"""README and docs: every command parses, every option, link and column named in them exists."""

import csv
import re
import sys
import tomllib

import pytest
from scenes.doc_commands import (
    COMMANDS,
    PAGES,
    SCRIPTS,
    Block,
    blocks,
    check,
    commands,
    option_names,
    prose_code,
    stage_option_names,
)
from scenes.finished_scene import finished_workspace
from scenes.tiny_plant import ROOT

from cotton3dg.cli.arguments import parse_overrides
from cotton3dg.cluster import stage as cluster
from cotton3dg.io.tables import BOLLS, TRAITS
from cotton3dg.option_rules import places
from cotton3dg.options import PRESET_VALUES, STAGE_OPTIONS, RenderOptions, resolve
from cotton3dg.segment import stage as segment
from cotton3dg.traits import stage as traits
from cotton3dg.workspace import Workspace

sys.path.append(str(ROOT / "tools"))
import doc_tables

FILE_ENDINGS = ("json", "csv", "npy", "npz", "ply", "png", "jpg", "py", "bin")
OTHER_PROGRAMS = {"--build-arg", "--fakeroot", "--no-build-isolation", "--no-normalize-world-space", "--user"}
TARGETS = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(), re.M))


def page_id(page):
    return str(page.relative_to(ROOT))


@pytest.mark.parametrize("page", [*PAGES, *SCRIPTS], ids=page_id)
def test_every_command_is_one_that_the_command_line_takes(page):
    lines = page.read_text().splitlines()
    if page.suffix == ".sh":
        lines = [line.removeprefix("#").strip() if "cotton3dg " in line else line for line in lines]
    found = [Block("", lines)] if page.suffix == ".sh" else blocks(page)
    for block in found:
        for words in commands(block.lines) if block.language != "python" else ():
            if words[0] == "make":
                assert {word for word in words[1:] if "=" not in word} <= TARGETS, words
            else:
                check(words)


@pytest.mark.parametrize("page", PAGES, ids=page_id)
def test_every_name_in_the_text_exists(page):
    for code in prose_code(page):
        for words in commands([code]):
            if words[0] == "make":
                assert {word for word in words[1:] if "=" not in word} <= TARGETS, words
            else:
                check(words, whole=False)
        first, _, rest = code.partition(" ")
        if first in COMMANDS and re.match(r"--\w", rest):
            check(["cotton3dg", *code.split()], whole=False)
        elif first.startswith("--") and first not in OTHER_PROGRAMS:
            assert first in option_names(), code
        stage, dot, name = code.partition(".")
        name = re.split(r"\W", name)[0]
        if dot and stage in STAGE_OPTIONS and name not in FILE_ENDINGS:
            assert {code, f"{stage}.{name}"} & stage_option_names(), code


def test_every_options_file_in_the_text_is_accepted():
    files = ["\n".join(block.lines) for page in PAGES for block in blocks(page) if block.language == "toml"]
    assert len(files) > 2
    for text in files:
        for stage, values in tomllib.loads(text).items():
            resolve(stage, values)


def refused(command):
    try:
        check(["cotton3dg", *command.split()])
    except Exception:
        return True
    return False


def test_a_renamed_option_is_noticed():
    for command in (
        "run",
        "run plant_017 --presett draft",
        "run plant_017 --preset daft",
        "run plant_017 --until harvest",
        "run plant_017 --set train.stepps=3",
        "harvest plant_017",
        "scale plant_017 --metod table",
        "scale plant_017 --method tables",
        "scale plant_017 --marker-cm ten",
    ):
        assert refused(command), command
    assert not refused("scale plant_017 --method all --marker-cm 10")
    assert not refused("train --help")
    assert sum(len(list(commands(block.lines))) for page in PAGES for block in blocks(page)) > 50
    assert list(commands(["a && cotton3dg run x || [ $? = 8 ] # cotton3dg no", "x | make y"])) == [
        ["cotton3dg", "run", "x"],
        ["make", "y"],
    ]


def anchors(text):
    return {re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-") for title in re.findall(r"^#+ (.*)$", text, re.M)}


@pytest.mark.parametrize("page", PAGES, ids=page_id)
def test_every_link_leads_somewhere(page):
    for target in re.findall(r"\]\(([^)\s]+)\)", page.read_text(encoding="utf-8")):
        if not target.startswith("http"):
            name, _, anchor = target.partition("#")
            file = (page.parent / name) if name else page
            assert file.exists(), target
            assert not anchor or anchor in anchors(file.read_text(encoding="utf-8")), target


@pytest.mark.parametrize("page", PAGES, ids=page_id)
def test_every_file_of_the_sources_that_the_text_names_exists(page):
    for code in prose_code(page):
        path = code.split()[0]
        if path.startswith(("cotton3dg/", "native/", "tests/", "tools/", "examples/", "docs/")):
            assert list(ROOT.glob(path)), path
        elif re.fullmatch(r"\w+/[\w/]+\.py", path):
            assert (ROOT / "cotton3dg" / path).is_file(), path


def test_each_function_of_the_walk_through_the_core_is_in_its_file():
    page = ROOT / "native" / "README.md"
    named = re.findall(r"`(?:\w+::)?(\w+)`[^`]*?\(`((?:src|vision)/[\w.]+)`\)", page.read_text(encoding="utf-8"))
    assert len(named) >= 12
    for name, file in named:
        assert re.search(rf"\b{name}\b", (page.parent / file).read_text(encoding="utf-8")), (name, file)
    files = re.findall(r"`((?:src|vision)/[\w.]+)`", page.read_text(encoding="utf-8"))
    assert {file for file in files if not (page.parent / file).is_file()} == set()


def test_each_question_of_a_newcomer_has_one_file_with_what_it_names():
    part = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8").split("\n## Thirty questions")[1].split("\n## ")[0]
    rows = [line.strip("| ").split(" | ") for line in part.splitlines() if line.endswith("|")][2:]
    assert len(rows) == 30
    for question, answer, sign in rows:
        file, name = answer.strip("`"), re.findall(r"`(\w+)`", sign)[0]
        assert re.search(rf"\b{name}\b", (ROOT / "cotton3dg" / file).read_text(encoding="utf-8")), question


def text_of(*names):
    return (ROOT / "docs").joinpath(*names).read_text(encoding="utf-8")


def test_words_in_quotation_marks_stand_on_the_pages_that_the_program_makes():
    pages = "".join(file.read_text(encoding="utf-8") for file in (ROOT / "cotton3dg/report/templates").iterdir())
    quoted = [words for page in PAGES for words in re.findall("“([A-Z][^”]+)”", page.read_text(encoding="utf-8"))]
    assert len(quoted) > 2
    assert [words for words in quoted if words not in pages] == []


def test_papers_md_has_the_defaults():
    rows = [
        row.split("|") for row in text_of("papers.md").split("\n## Constants")[1].split("\n## ")[0].splitlines()[3:]
    ]
    stated = {name: row[3] for row in rows if len(row) > 4 for name in re.findall(r"`([\w.]+)`", row[4])}
    defaults = {
        f"{stage}.{place.path}": place.item.default for stage, kind in STAGE_OPTIONS.items() for place in places(kind)
    }
    # 0 leaves the choice to the program.
    compared = {name: cell for name, cell in stated.items() if defaults.get(name) and re.search(r"\d", cell)}
    assert len(compared) > 10
    for name, cell in compared.items():
        assert f"{defaults[name]:g}" in re.findall(r"[\d.]+", cell), name


def test_papers_md_names_the_model_of_standard():
    (sets,) = re.findall(r"`([^`]*)` is the model of `standard`", text_of("papers.md"))
    named = parse_overrides(sets.replace("--set", "").split())["train"]
    assert resolve("train", PRESET_VALUES["paper2"]["train"], asked=named) == resolve("train")


def test_exports_md_names_the_file_of_a_film():
    name = f"{RenderOptions().view}_{RenderOptions().show}"
    assert f"`render/{name}/{name}.mp4`" in text_of("exports.md")


def test_public_machines_run_what_a_developers_machine_does_or_say_what_they_leave_out():
    files = [(ROOT / file).read_text(encoding="utf-8") for file in (".ci/run", ".github/workflows/checks.yml")]
    of_developers, public = (
        {w for targets in re.findall("make ([a-z -]+)", f) for w in targets.split()} for f in files
    )
    assert {"lint", "docs", "test"} <= of_developers <= public


def test_pictures_are_small():
    for picture in (ROOT / "docs" / "filming").iterdir():
        assert picture.stat().st_size < 100_000, picture


def test_pages_have_the_tables_of_columns_and_flags():
    found = []
    for page in doc_tables.PAGES:
        text = page.read_text(encoding="utf-8")
        found += doc_tables.MARKED.findall(text)
        assert text == doc_tables.with_tables(text), f"{page_id(page)} is out of date: make doc-tables"
    assert sorted(found) == sorted(doc_tables.TABLES)


def test_the_tables_of_traits_csv_have_each_column_once():
    tables = [table for name, table in doc_tables.TABLES.items() if name.startswith("traits.csv")]
    assert re.findall(r"^\| `(\w+)`", "".join(tables), re.M) == [column.name for column in TRAITS]


def test_a_changed_column_changes_its_page():
    text = "Before.\n\n<!-- table: branches.csv -->\n\n| a |\n|---|\n| old |\n\nBehind.\n"
    made = doc_tables.with_tables(text)
    assert made == doc_tables.with_tables(made)
    assert made.startswith("Before.\n\n<!-- table: branches.csv -->\n\n| column | unit |")
    assert made.endswith(" |\n\nBehind.\n")
    assert "old" not in made
    assert doc_tables.with_tables("<!-- table: branches.csv -->\n\nBehind.\n") == made.removeprefix("Before.\n\n")
    assert "| `diameter_mm` | mm | median width of its first 5 cm | too thin" in made
    assert doc_tables.markdown(["a"], ["b|c"]) == "| a |\n|---|\n| b\\|c |\n"
    with pytest.raises(KeyError):
        doc_tables.with_tables("<!-- table: leaves.csv -->\n")


def blank(path):
    with path.open(newline="") as file:
        return [{name for name, cell in row.items() if not cell} - {"qc_flags"} for row in csv.DictReader(file)]


def said_blank(columns, *reasons):
    return {column.name for column in columns if any(why in column.blank_when.split("; ") for why in reasons)}


@pytest.fixture(scope="module")
def finished(tmp_path_factory) -> Workspace:
    return finished_workspace(tmp_path_factory.mktemp("docs") / "plant")


def test_cells_are_blank_when_their_columns_say_so(finished):
    card = "fewer than three views show the grey patches of a card (`scale.method` card or all)"
    by_hand = "the masks do not come from the bolls' network on a trained model"
    usual = "no fit of weights (`traits.weight_model`)", "not corrected", card, by_hand
    assert blank(finished.traits_csv) == [said_blank(TRAITS, *usual)]
    scale = finished.scale_json.read_text()
    with finished.writing("scale") as made:
        (made / "scale.json").write_text('{"source": "none"}')
    traits.run(finished, resolve("traits"))
    assert blank(finished.traits_csv) == [said_blank(TRAITS, *usual, "no scale")]
    assert blank(finished.bolls_csv) == 4 * [said_blank(BOLLS, *usual, "no scale")]
    with finished.writing("scale") as made:
        (made / "scale.json").write_text(scale)
    with finished.writing("masks"):
        pass
    for module in (segment, cluster, traits):
        module.run(finished, resolve(module.STAGE.name))
    no_bolls = said_blank(
        TRAITS, *usual, "no bolls", "no boll with a volume", "fewer than two bolls", "no boll has a position"
    )
    assert blank(finished.traits_csv) == [no_bolls]
