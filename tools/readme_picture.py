# SPDX-License-Identifier: Apache-2.0
"""The picture of the README: three frames of a film, and the top of the report that was made of it (needs Chromium).

python tools/readme_picture.py plant_dir docs/film_to_report.jpg
"""

from __future__ import annotations

import io
import sys
import tempfile
from pathlib import Path
from typing import Final

from PIL import Image, ImageDraw

TESTS: Final = Path(__file__).parents[1] / "tests"
WIDTH_PX: Final = 900
"""Of the report in the browser, before it is made smaller."""
FRAME_PX: Final = (464, 261)
GAP_PX: Final = 12
ARROW_PX: Final = 70
INK: Final = (60, 90, 60)


def report_of(plant_dir: Path, height_px: int) -> Image.Image:
    """The top of the report, as the tests' browser shows it."""
    sys.path.append(str(TESTS))
    from scenes.chromium import Browser

    with tempfile.TemporaryDirectory() as profile, Browser(Path(profile), webgl=False) as browser:
        browser.open(plant_dir / "report.html", WIDTH_PX, height_px)
        return Image.open(io.BytesIO(browser.screenshot())).convert("RGB")


def picture(plant_dir: Path) -> Image.Image:
    """Frames from three sides, an arrow, and the report."""
    frames = sorted((plant_dir / "frames").glob("*.jpg"))
    sides = [frames[i * len(frames) // 3] for i in range(3)]
    height = 3 * FRAME_PX[1] + 2 * GAP_PX
    left = FRAME_PX[0] + ARROW_PX
    width = 1280 - left
    report = report_of(plant_dir, round(height * WIDTH_PX / width)).resize((width, height), Image.Resampling.LANCZOS)
    whole = Image.new("RGB", (1280, height), "white")
    for i, path in enumerate(sides):
        frame = Image.open(path).resize(FRAME_PX, Image.Resampling.LANCZOS)
        whole.paste(frame, (0, i * (FRAME_PX[1] + GAP_PX)))
    whole.paste(report, (left, 0))
    pen, middle = ImageDraw.Draw(whole), height // 2
    begin, end = FRAME_PX[0] + GAP_PX, left - GAP_PX
    pen.rectangle((begin, middle - 4, end - 18, middle + 4), fill=INK)
    pen.polygon([(end - 22, middle - 18), (end, middle), (end - 22, middle + 18)], fill=INK)
    pen.rectangle((left, 0, 1279, height - 1), outline=(200, 200, 200))
    return whole


if __name__ == "__main__":
    picture(Path(sys.argv[1])).save(sys.argv[2], quality=85)
