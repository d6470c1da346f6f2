# SPDX-License-Identifier: Apache-2.0
"""What the site has besides docs/ (mkdocs calls these hooks): README and its like, references made from the code, the
notebook as a page, and the reports that `make gallery` made.

The pages of docs/ link to files beside them in the repository, so that they can be read there, too. Such a link leads
to the page that the site has of that file, or to a copy of it (tests, examples).
"""

from __future__ import annotations

import json
import posixpath
import re
import sys
from pathlib import Path
from typing import Any

import typer
from mkdocs.structure.files import File, Files

import cotton3dg
from cotton3dg.cli.app import app

ROOT = Path(__file__).parents[1]
PAGES = {
    "README.md": "index.md",
    "CONTRIBUTING.md": "CONTRIBUTING.md",
    "native/README.md": "native.md",
    "tests/README.md": "tests.md",
    "CHANGELOG.md": "CHANGELOG.md",
}
"""Page of the repository -> of the site."""
NOTEBOOK = "examples/tutorial.ipynb"
OTHERS = {NOTEBOOK: "tutorial.md", "examples": "examples/one_plant.sh"}
"""What a page of the repository may link to -> what the site has of it."""
REPORTS = ROOT / "build" / "gallery"
LINK = re.compile(r"\]\(([^)\s#]+)(#[^)\s]*)?\)")


def on_config(config: Any) -> Any:
    """The notebook's pages stand in the navigation in the order in which its first page lists them."""
    for entry in config.nav:
        for title, pages in entry.items() if isinstance(entry, dict) else ():
            if title == "Laboratory notebook":
                listed = re.findall(r"\]\((\w+\.md)\)", (ROOT / "docs" / "notes" / "README.md").read_text("utf-8"))
                entry[title] = [pages[0], *(f"notes/{name}" for name in dict.fromkeys(listed))]
    return config


def on_files(files: Files, config: Any) -> Files:
    texts = {site: (ROOT / name).read_text("utf-8") for name, site in PAGES.items()}
    texts |= {"commands.md": command_reference(), "python_reference.md": python_reference()}
    texts |= {"tutorial.md": notebook_page(), "gallery.md": gallery_page()}
    for name, text in texts.items():
        files.append(File.generated(config, name, content=text))
    for path in sorted(linked_files()):
        files.append(File.generated(config, path, abs_src_path=str(ROOT / path)))
    for name, report in gallery().items():
        files.append(File.generated(config, f"reports/{name}.html", abs_src_path=str(report)))
    return files


def on_page_markdown(markdown: str, page: Any, config: Any, files: Files) -> str:
    """Links as the site has the files; those of the repository's own pages are relative to its root."""
    source = next((name for name, site in PAGES.items() if site == page.file.src_uri), f"docs/{page.file.src_uri}")

    def of_site(link: re.Match[str]) -> str:
        target, anchor = link[1], link[2] or ""
        if "://" in target:
            return link[0]
        path = posixpath.normpath(posixpath.join(posixpath.dirname(source), target))
        path = path.removeprefix("docs/") if path.startswith("docs/") else (PAGES | OTHERS).get(path, path)
        return f"]({posixpath.relpath(path, posixpath.dirname(page.file.src_uri) or '.')}{anchor})"

    return LINK.sub(of_site, markdown)


def linked_files() -> set[str]:
    """Files of the repository, besides pages and docs/, that a page links to."""
    found = {"examples/one_plant.sh"}
    for page in [*(ROOT / name for name in PAGES), *(ROOT / "docs").rglob("*.md")]:
        for link in LINK.finditer(page.read_text("utf-8")):
            path = (page.parent / link[1]).resolve()
            if "://" not in link[1] and path.is_file() and path.is_relative_to(ROOT):
                name = path.relative_to(ROOT).as_posix()
                if not name.startswith("docs/") and name not in PAGES:
                    found.add(name)
    return found


def notebook_page() -> str:
    """The tutorial as a page: its texts, and its code to copy."""
    notebook = json.loads((ROOT / NOTEBOOK).read_text("utf-8"))
    cells = [(cell["cell_type"], "".join(cell["source"])) for cell in notebook["cells"]]
    return "\n\n".join(text if kind == "markdown" else f"```python\n{text}\n```" for kind, text in cells)


def gallery() -> dict[str, Path]:
    """Name -> report of each plant that `make gallery` has made."""
    return {path.parent.name: path for path in sorted(REPORTS.glob("*/report.html"))}


def gallery_page() -> str:
    """A link to each."""
    links = [f"- [{name.replace('_', ' ').capitalize()}](reports/{name}.html)" for name in gallery()]
    made = links or ["`make gallery` makes them; then `make docs` again."]
    title = "# Reports to look at\n\nSimulated plants, each in one page as `cotton3dg run` writes it.\n\n"
    return title + "\n".join(made)


def command_reference() -> str:
    """All commands with their arguments and options."""
    group: Any = typer.main.get_command(app)
    lines = ["# Commands", "", f"{group.help}", ""]
    for name, command in group.commands.items():
        wanted = [item for item in command.params if item.param_type_name == "argument"]
        words = " ".join(item.metavar or item.name.upper() for item in wanted)
        lines += [f"## {name}", "", f"    cotton3dg {name} {words}".rstrip(), "", (command.help or "").strip(), ""]
        options = [item for item in command.params if item.param_type_name == "option" and not item.hidden]
        if options:
            lines += ["| option | meaning |", "|---|---|"]
            lines += [_option_row(item) for item in options] + [""]
    return "\n".join(lines)


def _option_row(item: Any) -> str:
    flags = ", ".join(f"`{flag}`" for flag in (*item.opts, *item.secondary_opts))
    default = f" (default: {item.default})" if item.show_default and item.default not in (None, False, "") else ""
    return f"| {flags} | {(item.help or '').replace('|', chr(92) + '|')}{default} |"


def python_reference() -> str:
    """Every public name, by the module that it comes from."""
    lines = [
        "# Python reference",
        "",
        "What `import cotton3dg` offers, by part of the program; [an overview](python.md).",
        "",
    ]
    for module, names in cotton3dg._HOMES.items():
        for name in names:
            lines += [f"::: cotton3dg.{module}.{name}", "    options: {heading_level: 2, members: null}", ""]
    return "\n".join(lines)


if __name__ == "__main__":
    sys.exit("mkdocs calls this: make docs")
