# SPDX-License-Identifier: Apache-2.0
"""How far a run is, by its log; and which pages may ask the server."""

from datetime import datetime
from pathlib import Path

import pytest

from cotton3dg.report.live import SANDBOX, opened, view_page, working_text
from cotton3dg.workspace import Workspace

NOW = datetime(2026, 1, 1, 10, 5, 30)
BEGUN = "2026-01-01 10:00:00,100 INFO {} starts: no finished result\n"


@pytest.mark.parametrize(
    ("log", "text"),
    [
        ("", "at work"),
        (BEGUN.format("frames"), "frames, stage 1 of 8, for 5 min"),
        (BEGUN.format("frames").replace("10:00", "10:05"), "frames, stage 1 of 8"),
        (BEGUN.format("frames").replace("10:00", "10:07"), "frames, stage 1 of 8"),
        ("2026-01-01 10:00:00,100 INFO sfm begins\n", "sfm, stage 2 of 8, for 5 min"),
        (BEGUN.format("train") + "2026-01-01 10:01:00,100 WARNING train: dark\n", "train, stage 3 of 8, for 5 min"),
        (BEGUN.format("train") + "2026-01-01 10:01:00,100 INFO train done in 60.0 s: {}\n", "at work"),
        (BEGUN.format("train") + "2026-01-01 10:01:00,100 ERROR train failed: full\n", "at work"),
        (BEGUN.format("harvest"), "at work"),
        (BEGUN.format("frames") + "x" * 2**17 + "\n", "at work"),
    ],
)
def test_the_last_begin_of_a_log_tells_the_stage(tmp_path: Path, log: str, text: str) -> None:
    workspace = Workspace(tmp_path)
    assert working_text(workspace, NOW) == "at work"
    workspace.log_file.write_text(log)
    assert working_text(workspace, NOW) == text


def test_only_a_page_with_a_script_of_this_version_may_ask() -> None:
    page, policy = opened(view_page("field <b>", is_field=True), 0)
    assert b"connect-src 'self'" in page and b"data-view>" in page and b"field &lt;b&gt;" in page
    assert "connect-src 'self'" in policy and "'unsafe-inline'" not in policy
    for other in (b"", b"<title>mine</title>", view_page("", is_field=False).replace(b"sha256-", b"sha256_")):
        assert opened(other, 0) == (other, SANDBOX)


@pytest.mark.parametrize(("depth", "href"), [(0, None), (1, "./"), (2, "../"), (3, "../../")])
def test_a_page_leads_back_to_the_first_one(depth: int, href: str | None) -> None:
    page, _ = opened(b"<html><body><h1>plant</h1></body>", depth)
    assert (f'<a href="{href}">Back to the table</a>'.encode() in page) == (href is not None)
    assert page.endswith(b"<h1>plant</h1></body>")
    # Who comes by keyboard skips all of it with the first link.
    skip = b'<body>\n<a class="skip" href="#bolls">To the bolls</a>'
    page, _ = opened(b"<html>" + skip + b"<h1>plant</h1></body>", depth)
    assert page.startswith(b"<html>" + skip) and (b"Back" in page) == (href is not None)
