# SPDX-License-Identifier: Apache-2.0
"""report.html of a plant: one file that opens from disk without a network.

The page is closed by a Content-Security-Policy: nothing is fetched, and only the scripts whose hashes stand in it run.
All text from files goes through jinja2's escaping.
"""

from __future__ import annotations

import base64
import hashlib
import logging
import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from decimal import Decimal
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from .. import __version__
from ..core.measurements import is_counted
from ..core.runs import State
from ..errors import BadInput, Cotton3dgError
from ..io.saving import explain_disk_errors, file_sha256, write_text_atomically
from ..io.skeleton import draw_map
from ..io.tables import flags_of, parse_number
from ..options import STANDARD
from ..schemas.check import GREEN, RED
from ..schemas.document import Document
from ..stage import STAGES
from ..workspace import Workspace
from .advice import advise_on_capture, boll_doubts, flagged_bolls, meaning
from .facts import Facts, read_facts
from .pictures import Pictures
from .pointing import describe_photos
from .verdicts import interval_of, of_row, rounded, sureness_of, sureness_words

if TYPE_CHECKING:
    from markupsafe import Markup

VERSION: Final = 11
RECORD: Final = "report"
TEMPLATES: Final = Path(__file__).with_name("templates")
OWN_TITLE: Final = "– cotton3dg</title>".encode()
OF_THE_PROGRAM: Final = ("report_version", "cotton3dg_version", "templates")
"""The parts of a fingerprint that another version of the program changes."""
UNSURE: Final = 0.9
"""Confidence below which a boll is named where a count is less sure than usual; ..."""
MOST_NAMED: Final = 5
"""... no more than so many."""
PHONE_PX: Final = 360.0
"""Width of the plant map on a phone, where its letters have the size that they are drawn at."""
MARKED_BYTES: Final = 4096
"""The first bytes of a page, which show whether this tool made it."""
log = logging.getLogger("cotton3dg")


@dataclass(frozen=True)
class Fingerprint(Document):
    """records/report.json: what a page was made from."""

    REMEDY = "run `cotton3dg report`"

    report_version: int
    cotton3dg_version: str
    templates: dict[str, str]
    """SHA-256 by name."""
    records: dict[str, str]
    """SHA-256 of the stages' records, which hold the hashes of all files."""
    failure: str
    page: str
    """SHA-256 of the page itself."""


def is_stale(workspace: Workspace, failure: str = "") -> bool:
    """Whether a new page would differ and be no worse: photos that `clean` dropped are only in the old one."""
    if not workspace.report_html.is_file():
        return True
    try:
        made = Fingerprint.load(workspace.record_file(RECORD))
    except BadInput:
        return True
    now = _fingerprint(workspace, failure)
    if workspace.dropped():
        now = replace(now, **{name: getattr(made, name) for name in OF_THE_PROGRAM})
    return made != now


def make_report(workspace: Workspace, failure: str = "") -> Path:
    """Write report.html from what the folder holds, whether or not the plant has a result.

    Args:
        failure: why there is no result, if the records do not say.
    """
    write_page(workspace.report_html, plant_page(workspace, failure))
    workspace.keep(_fingerprint(workspace, failure), RECORD)
    return workspace.report_html


def write_page(path: Path, text: str) -> None:
    """Save a page; never replace one that this tool did not make.

    Raises:
        BadInput: a file of this name was not made by this tool.
    """
    with explain_disk_errors(path.parent):
        if path.exists() and OWN_TITLE not in path.read_bytes()[:MARKED_BYTES]:
            raise BadInput(
                f"{path.name} stands where cotton3dg writes its page but was not made by it; move it elsewhere"
            )
        write_text_atomically(path, text)


def plant_page(workspace: Workspace, failure: str = "") -> str:
    """The page as HTML. If a part cannot be made, a remark takes its place and all other parts stay."""
    facts = read_facts(workspace)
    pictures = Pictures(workspace, facts)
    trouble: dict[str, str] = {}

    def part(name: str, make: Callable[[], Any]) -> Any:
        try:
            return make()
        except Cotton3dgError as error:
            trouble[name] = str(error)
        except Exception as error:  # a page that lacks a picture is worth more than none
            log.exception("the report's part %s", name)
            trouble[name] = f"{type(error).__name__}: {error}"
        return None

    cut_outs = part("cut_outs", pictures.cut_outs) or {}
    scene = part("scene", pictures.scene) or {}
    content = {
        "facts": facts,
        "failure": failure or facts.failure,
        "verdict": give_verdict(facts, failure),
        "headline": write_headline(facts),
        "traits": trait_cards(facts),
        "flags": [{"name": flag, "words": meaning(flag), "bolls": flagged_bolls(facts, flag)} for flag in facts.flags],
        "counted": part("counted", pictures.counted) or [],
        "plant_maps": part("plant_map", lambda: drawn_maps(pictures)) or [],
        "bolls": part("bolls", lambda: boll_rows(facts, cut_outs)) or [],
        "compared": part("compared", pictures.compared) or [],
        "overlaid": part("overlaid", pictures.overlaid) or [],
        "references": part("references", pictures.references) or [],
        "walk": part("walk", pictures.walk) or {},
        "strip": part("strip", pictures.strip) or [],
        "advice": part("advice", lambda: advise_on_capture(facts, pictures.widths_px())) or [],
        "stages": stage_rows(facts),
        "scene_picture": scene.pop("picture", ""),
        "scene": scene,
        "photos": part("photos", lambda: describe_photos(pictures)) or {},
        "trouble": trouble,
        "version": __version__,
    }
    names = ["table.js", "mend.js", "photos.js", "report.js"]
    if scene:
        names += ["splats.js", "orbit.js", "plant3d.js"]
    return fill_template("report.html", [(TEMPLATES / name).read_text("utf-8") for name in names], content)


def fill_template(template: str, scripts: list[str], content: dict[str, Any]) -> str:
    """A template filled in, with its style and scripts inside."""
    from jinja2 import Environment, FileSystemLoader, StrictUndefined
    from markupsafe import Markup

    environment = Environment(
        loader=FileSystemLoader(TEMPLATES),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {"figure": format_figure, "meaning": meaning}
    hashes = [base64.b64encode(hashlib.sha256(text.encode("utf-8")).digest()).decode() for text in scripts]
    return environment.get_template(template).render(
        style=Markup((TEMPLATES / "style.css").read_text("utf-8")),
        scripts=[Markup(text) for text in scripts],
        hashes=hashes,
        **content,
    )


def give_verdict(facts: Facts, failure: str) -> dict[str, str]:
    """Whether to trust the row, at a glance."""
    if failure or facts.failure:
        return {"verdict": RED, "text": "No result"}
    doubtful = sum(bool(boll_doubts(row)) for row in facts.bolls)
    verdict, text = of_row(facts.flags, doubtful, facts.traits)
    return {"verdict": verdict, "text": text}


def write_headline(facts: Facts) -> str:
    """The film and its outcome in one line."""
    parts = []
    if facts.frames:
        parts.append(facts.frames.file or "photos")
        if video := facts.frames.video:
            parts.append(f"{format_figure(video.duration_s)} s, {video.width} × {video.height} px")
    if facts.traits:
        parts.append(f"{facts.traits.get('n_frames')} frames, {facts.traits.get('registered_pct')} % placed")
        preset = "" if facts.preset == STANDARD else f" with {facts.preset}"
        parts.append(f"measured in {format_figure(facts.traits.get('seconds'), 0)} s{preset}")
    return "; ".join(parts) or "nothing could be read from what was filmed"


def trait_cards(facts: Facts) -> list[dict[str, str]]:
    """The four traits with their errors, as far as these are known."""
    if not facts.traits:
        return []
    row = facts.traits
    counted = [boll for boll in facts.bolls if is_counted(flags_of(boll))]
    doubtful = sum(bool(boll_doubts(boll)) for boll in counted)

    table = facts.scale.table_words if facts.scale else ""

    def metric(name: str, column: str, unit: str, digits: int, *notes: str) -> dict[str, str]:
        value, low, high = interval_of(row, column)
        note = "; ".join(note for note in notes if note)
        if not math.isfinite(value):
            no_bolls = column == "boll_volume_cm3" and not counted
            why = "no scale" if "no_scale" in facts.flags else "no boll to measure" if no_bolls else "see the flags"
            return {"name": name, "value": "–", "unit": "", "range": "", "sure": "", "sureness": "", "note": why}
        limits = f"{rounded(low, digits)} to {rounded(high, digits)} {unit}" if math.isfinite(low + high) else ""
        shown = {"name": name, "value": rounded(value, digits), "unit": unit, "range": limits}
        sure = {"sure": sureness_of(row, column) or "", "sureness": sureness_words(row, column)}
        return shown | sure | {"note": note}

    mean = parse_number(row.get("boll_volume_mean_cm3"))
    solid = [parse_number(boll.get("alpha_volume_cm3")) for boll in counted]
    volume_note = f"{rounded(mean, 1)} cm³ a boll" if math.isfinite(mean) else ""
    if solid and math.isfinite(sum(solid)):
        volume_note += f"; {sum(solid):.0f} cm³ without hollows"
    length, width = parse_number(row.get("canopy_length_cm")), parse_number(row.get("canopy_width_cm"))
    canopy_note = (
        f"{rounded(length, 1)} × {rounded(width, 1)} cm seen from above" if math.isfinite(length + width) else ""
    )
    low, high = (row.get(f"boll_count_{end}", "") for end in ("low", "high"))
    count_range = f"{low} to {high}" if low != high else ""
    count_notes = [f"{doubtful} of them doubtful" if doubtful else "none doubtful"] if counted else []
    if sureness_of(row, "boll_count") != GREEN or "touching_bolls" in flags_of(row):
        count_notes.append(_least_sure(counted))
    if row.get("boll_count_odd"):
        count_notes.append(f"halves of the images count {row['boll_count_odd']} and {row['boll_count_even']}")
    count_note = "; ".join(filter(None, count_notes))
    return [
        {"name": "Bolls", "value": row.get("boll_count", "–"), "unit": "", "range": count_range, "note": count_note}
        | {"sure": sureness_of(row, "boll_count") or "", "sureness": sureness_words(row, "boll_count")},
        metric("Boll volume", "boll_volume_cm3", "cm³", 0, volume_note, table),
        metric("Plant height", "plant_height_cm", "cm", 1, "above the table top", table),
        metric("Canopy size", "canopy_size_cm", "cm", 1, canopy_note, table),
    ]


def _least_sure(bolls: list[dict[str, str]]) -> str:
    """The bolls that make a count unsure, as they may be none or two; empty if all are sure."""
    sure = {boll["boll_id"]: parse_number(boll.get("confidence")) for boll in bolls}
    least = sorted((share, name) for name, share in sure.items() if share < UNSURE)[:MOST_NAMED]
    return f"least sure: {', '.join(f'boll {name} ({100 * share:.0f} %)' for share, name in least)}" if least else ""


def boll_rows(facts: Facts, cut_outs: dict[int, list[dict[str, str]]]) -> list[dict[str, Any]]:
    """The boll table, with cut-outs and with doubts in words."""
    from .figures import colour_of

    return [
        {
            **row,
            "doubts": boll_doubts(row),
            "colour": "rgb({},{},{})".format(*colour_of(int(row["boll_id"]))),
            "cut_outs": cut_outs.get(int(row["boll_id"]), []),
            "centre_cm": _centre(row),
        }
        for row in facts.bolls
    ]


def drawn_maps(pictures: Pictures) -> list[Markup]:
    """The plant map for screens and for phones, SVGs inside the page, of numbers and the program's own words."""
    from markupsafe import Markup

    found = pictures.plant_map
    return [Markup(draw_map(found, most_px=most_px)) for most_px in (math.inf, PHONE_PX)] if found else []


def _centre(row: dict[str, str]) -> str:
    """The centre of a boll as corrections name it, `[x,y,z]` cm; empty if it is not known."""
    places = [parse_number(row.get(f"{axis}_cm")) for axis in "xyz"]
    return str(places).replace(" ", "") if all(map(math.isfinite, places)) else ""


def stage_rows(facts: Facts) -> list[dict[str, Any]]:
    """Seconds, memory, key figures and remarks of each stage."""
    longest = max([*(item.record.seconds for item in facts.stages if item.record), 1e-9])
    words = {State.MISSING: "not run", State.STALE: "out of date"}
    return [
        {
            "stage": item.stage,
            "state": words.get(item.state, item.state),
            "seconds": record and record.seconds,
            "cpu_seconds": record and record.cpu_seconds,
            "memory_mib": record and record.peak_memory_mib,
            "share": 100 * record.seconds / longest if record else 0.0,
            "summary": _format_summary(record.summary) if record and item.done else "",
            "remarks": [item.reason] if item.state == State.FAILED else record.warnings if record else [],
        }
        for item, record in ((item, item.record) for item in facts.stages)
    ]


def format_figure(value: Any, digits: int = 1) -> str:
    """A number for people; a dash where there is none."""
    known = parse_number(value)
    return f"{Decimal(rounded(known, digits)):,}".replace(",", "\u202f") if math.isfinite(known) else "–"


def _format_summary(summary: dict[str, Any]) -> str:
    single = {key: value for key, value in summary.items() if not isinstance(value, (list, dict))}
    return ", ".join(
        f"{key.replace('_', ' ')} {value:.4g}" if isinstance(value, float) else f"{key.replace('_', ' ')} {value}"
        for key, value in list(single.items())[:6]
    )


def _fingerprint(workspace: Workspace, failure: str) -> Fingerprint:
    records = {stage: workspace.record_file(stage) for stage in STAGES}
    return Fingerprint(
        report_version=VERSION,
        cotton3dg_version=__version__,
        templates={path.name: file_sha256(path) for path in sorted(TEMPLATES.iterdir())},
        records={stage: file_sha256(path) for stage, path in records.items() if path.is_file()},
        failure=failure,
        page=file_sha256(workspace.report_html) if workspace.report_html.is_file() else "",
    )
