# SPDX-License-Identifier: Apache-2.0
"""Words and patterns that a reader stumbles over: none in the docs, nor in the docstrings, comments and messages.

Each pattern has its reason and a better form. A sentence that needs such a word stands in `ALLOWED`, with the reason.
"""

import ast
import io
import re
import tokenize
from typing import NamedTuple

import pytest
from scenes.doc_commands import PAGES
from scenes.tiny_plant import ROOT

NOTES = ROOT / "docs" / "notes"
READ = [page for page in PAGES if NOTES not in page.parents]
MODULES = sorted((ROOT / "cotton3dg").rglob("*.py"))


class Unwanted(NamedTuple):
    pattern: str
    reason: str
    better: str


COMPARED = "longer|more|less|fewer|farther|nearer|wider|larger|smaller|better|worse"
UNWANTED = (
    Unwanted(r"\bof which\b", "the reader has to look back for the noun", "a second sentence"),
    Unwanted(rf"(?<!there )\b(?:is|are) no (?!(?:{COMPARED})\b)[a-z]+", "poetic", "is not a ..."),
    Unwanted(r"\b(?:told|hear|hears|heard)\b", "programs have no ears", "gets, reads, receives; distinguishes"),
    Unwanted(r"\bsaid\b", "no person speaks", "reported, recorded, listed"),
    Unwanted(r"\bso manieth\b", "not English", "every n-th"),
    Unwanted(
        r"(?:^|[.:;] )What (?!a |an )[^.?:;]{3,80}? (?:is|are) \w+(?:ed|pt|ft|en|un)\b(?![^.]*\?)",
        "a clause as the subject",
        "name the thing: The program drops images that ...",
    ),
    Unwanted(r"\bsuch a one\b|\bfor want of\b|\bneeds? but\b|\bthereof\b|\bwherein\b", "old", "plain words"),
    Unwanted(r"\b(?:may|might) linger\b", "a walk does not linger", "name what somebody does"),
)
ALLOWED: dict[str, str] = {}
"""A part of a sentence -> why the word is right there."""


def hits(texts):
    """(line, text found, better form) of each unwanted pattern."""
    for line, text in texts:
        flat = re.sub(r"\s+", " ", text)
        for part in ALLOWED:
            flat = flat.replace(part, "")
        for item in UNWANTED:
            for found in re.finditer(item.pattern, flat, re.IGNORECASE):
                yield line, found[0].strip(), f"{item.reason}; better: {item.better}"


def paragraphs(page):
    """(line, text) of a page without code."""
    text = re.sub(r"^```.*?^```", lambda block: "\n" * block[0].count("\n"), page, flags=re.M | re.S)
    text = re.sub(r"^ {4}\S.*$", "", text, flags=re.M)
    text = re.sub(r"`[^`\n]*`", "CODE", text)
    for found in re.finditer(r"[^\n]+(?:\n[^\n]+)*", text):
        kind = r"\n(?=\s*(?:[-*|#]|\d+\.) ?)"
        line = text.count("\n", 0, found.start()) + 1
        for part in re.split(kind, found[0]):
            yield line, part
            line += part.count("\n") + 1


def prose(source):
    """(line, text) of docstrings, comments and messages; comments of successive lines are one text."""
    nodes = list(ast.walk(ast.parse(source)))
    pieces = {id(part) for node in nodes if isinstance(node, ast.JoinedStr) for part in node.values}
    for node in nodes:
        if isinstance(node, ast.JoinedStr):
            parts = (part.value if isinstance(part, ast.Constant) else "NAME" for part in node.values)
            yield node.lineno, "".join(map(str, parts))
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in pieces:
            for paragraph in node.value.split("\n\n"):
                yield node.lineno, paragraph
    comments: list[tuple[int, str]] = []
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type == tokenize.COMMENT:
            text = token.string.lstrip("# ")
            if comments and token.start[0] == comments[-1][0] + comments[-1][1].count("\n") + 1:
                first, before = comments.pop()
                text, line = f"{before}\n{text}", first
            else:
                line = token.start[0]
            comments.append((line, text))
    yield from comments


def name_of(path):
    return path.relative_to(ROOT).as_posix()


@pytest.mark.parametrize("page", READ, ids=name_of)
def test_a_page_has_no_unwanted_words(page):
    assert list(hits(paragraphs(page.read_text(encoding="utf-8")))) == []


def test_the_package_has_no_unwanted_words():
    found = [(name_of(file), *hit) for file in MODULES for hit in hits(prose(file.read_text(encoding="utf-8")))]
    assert found == []


def test_each_exception_is_still_needed():
    texts = [page.read_text(encoding="utf-8") for page in READ] + [file.read_text(encoding="utf-8") for file in MODULES]
    flat = [re.sub(r"\s+", " ", text) for text in texts]
    assert [part for part in ALLOWED if not any(part in text for text in flat)] == []


@pytest.mark.parametrize(
    "text",
    [
        "Plants of which half are cut.",
        "It is no boll.",
        "The part is told in degrees.",
        "All that was said is kept.",
        "What is less like lint than the others is dropped.",
        "The first sentence ends. What no view shows is left out.",
    ],
)
def test_an_unwanted_form_is_found(text):
    assert list(hits([(1, text)]))


@pytest.mark.parametrize(
    "text",
    [
        "There is no model.",
        "The error is no longer than a pixel, and no more than 1 %.",
        "What is a boll? It is opened cotton.",
        "The columns say what is left out.",
    ],
)
def test_a_plain_form_is_not(text):
    assert not list(hits([(1, text)]))


def test_code_is_not_prose():
    assert list(paragraphs("A `said` word.\n\n```\nsaid\n```\n\n    said\n")) == [(1, "A CODE word.")]
    assert list(prose('said = 1\n# one\n# two\nf"a {said} b"\n')) == [(4, "a NAME b"), (2, "one\ntwo")]
