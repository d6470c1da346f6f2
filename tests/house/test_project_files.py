# SPDX-License-Identifier: Apache-2.0
"""What strangers meet first: pyproject.toml, citation, forms, workflows and hooks agree with each other."""

import re
import tomllib

import yaml
from scenes.doc_commands import COMMANDS
from scenes.tiny_plant import ROOT

import cotton3dg


def text_of(name):
    return (ROOT / name).read_text(encoding="utf-8")


def parsed(name):
    return yaml.safe_load(text_of(name))


PYPROJECT = tomllib.loads(text_of("pyproject.toml"))
PROJECT = PYPROJECT["project"]
UNKNOWN = "URL_OF_THIS_REPOSITORY"
"""Pages say this as long as pyproject.toml has no address of the repository."""
ADDRESS = PROJECT["urls"].get("Repository")
REPEATED = ("CITATION.cff", "docs/install.md", "mkdocs.yml")
"""Files that need the address, besides pyproject.toml."""
HOOKS = {"ruff-pre-commit": "ruff", "mirrors-clang-format": "clang-format", "codespell": "codespell"}
"""Repository of a hook -> the library that it runs."""


def test_the_version_has_one_source():
    assert PROJECT["dynamic"] == ["version"]
    (entry,) = PYPROJECT["tool"]["dynamic-metadata"]
    assert f'__version__ = "{cotton3dg.__version__}"' in text_of(entry["input"]).splitlines()
    assert re.findall(r"^## (\S+)", text_of("CHANGELOG.md"), re.M)[0] == cotton3dg.__version__
    assert not {"version", "date-released"} & set(parsed("CITATION.cff"))
    assert not re.search(r"^project\(.*VERSION", text_of("native/CMakeLists.txt"), re.M)


def test_the_pythons_that_are_named_are_those_that_are_tested_and_built():
    named = re.findall(r"Python :: (3\.\d+)", " ".join(PROJECT["classifiers"]))
    assert PROJECT["requires-python"] == f">={named[0]}"
    assert PYPROJECT["tool"]["cibuildwheel"]["build"] == [f"cp{python.replace('.', '')}-*" for python in named]
    for file, job in (("checks", "test"), ("wheels", "installed")):
        assert parsed(f".github/workflows/{file}.yml")["jobs"][job]["strategy"]["matrix"]["python"] == named


def test_hooks_have_the_versions_of_the_constraints():
    pinned = dict(line.split("==") for line in text_of("constraints.txt").splitlines() if "==" in line)
    hooks = {repo["repo"].rsplit("/", 1)[1]: repo["rev"] for repo in parsed(".pre-commit-config.yaml")["repos"]}
    assert set(hooks) == set(HOOKS)
    compared = {hook: f"v{pinned[library]}" for hook, library in HOOKS.items() if library in pinned}
    assert len(compared) > 1
    assert hooks | compared == hooks


def test_the_citation_says_what_other_files_say():
    citation = parsed("CITATION.cff")
    assert citation["license"] == PROJECT["license"]
    assert citation["keywords"] == PROJECT["keywords"]
    assert citation["authors"] == PROJECT["authors"]
    papers = " ".join(text_of("docs/papers.md").split())
    assert len(citation["references"]) == 2
    for paper in citation["references"]:
        if "doi" in paper:
            assert f"https://doi.org/{paper['doi']}" in papers
            assert paper["title"] in papers


def test_the_address_of_the_repository_stands_in_pyproject_and_is_repeated_from_there():
    assert ADDRESS or not PROJECT["urls"], "Repository is the first address"
    assert parsed("CITATION.cff").get("repository-code") == ADDRESS
    assert parsed("mkdocs.yml").get("repo_url") == ADDRESS
    assert f"git clone {ADDRESS or UNKNOWN} cotton3dg" in text_of("docs/install.md")


def test_no_other_file_has_an_address_of_the_project():
    patterns = ("*.md", "*.cff", "*.yml", ".github/**/*.yml", ".github/*.md", "docs/**/*.md", "cotton3dg/**/*.py")
    files = {path.relative_to(ROOT).as_posix() for pattern in patterns for path in ROOT.glob(pattern)}
    own = re.compile(r"https?://(?!127\.0\.0\.1|localhost)[^\s()<>\"']*/cotton3dg\b")
    assert files > set(REPEATED)
    assert [name for name in sorted(files - set(REPEATED)) if own.search(text_of(name))] == []


def test_forms_name_commands_that_exist():
    for form in ("bug_report", "feature_request"):
        found = parsed(f".github/ISSUE_TEMPLATE/{form}.yml")
        assert {"name", "description", "body"} <= set(found)
        named = re.findall(r"`cotton3dg ([a-z][\w-]*)", str(found))
        assert set(named) <= set(COMMANDS)
        assert form != "bug_report" or "bug-report" in named
