# SPDX-License-Identifier: Apache-2.0
"""What tests of the pages share: a parser, a hostile text, rows of a batch."""

from html.parser import HTMLParser

import cv2
import numpy as np

from cotton3dg.io.tables import TRAITS
from cotton3dg.schemas.record import Record

HOSTILE = "<img src=x onerror=document.title='owned'>\"'&{{7*7}}</script><script>document.title='owned'</script>"


class Page(HTMLParser):
    """Tags, their attributes and the text outside of scripts and styles."""

    def __init__(self, text: str):
        super().__init__(convert_charrefs=True)
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.text = ""
        self._silent = 0
        self.feed(text)
        self.text = " ".join(self.text.split())

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))
        self._silent += tag in ("script", "style")

    def handle_endtag(self, tag):
        self._silent -= tag in ("script", "style")

    def handle_data(self, data):
        self.text += "" if self._silent else data + " "

    def count(self, tag, **wanted):
        return sum(name == tag and all(found.get(k) == v for k, v in wanted.items()) for name, found in self.tags)


def fail(workspace, stage, error):
    workspace.write_record(Record(stage, error=error, exit_code=4, seconds=3.0))


def batch_row(folder, state="done", **cells):
    blank = {column.name: None for column in TRAITS}
    return {"folder": folder, "state": state, "exit_code": 0, "reason": "", **blank, **cells}


def batch_rows():
    rows = [
        batch_row("bad", "failed", reason=f"no {HOSTILE}; film it"),
        batch_row("sp ace/#%", boll_count=12, boll_volume_cm3=500.0, plant_height_cm=160.0, canopy_size_cm=30.0),
    ]
    for k in range(6):
        cells = {"boll_count": 10 + k, "boll_volume_cm3": 400.0 + 10 * k, "plant_height_cm": 70.0 + k}
        rows.append(
            batch_row(f"plant_{k}", canopy_size_cm=35.0 + k / 2, qc_flags="orbit_gap" if k == 3 else "", **cells)
        )
    return rows


def picture(png):
    return cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_COLOR)
