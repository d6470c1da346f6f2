# SPDX-License-Identifier: Apache-2.0
"""What a report says at a glance: only a row that is as sure as usual has passed all checks."""

from dataclasses import replace

import pytest

from cotton3dg.option_rules import as_dict
from cotton3dg.options import PRESET_VALUES, PRESETS, resolve
from cotton3dg.report.advice import boll_doubts, flagged_bolls
from cotton3dg.report.facts import Facts, preset_of
from cotton3dg.report.page import format_figure, give_verdict, trait_cards, write_headline
from cotton3dg.report.verdicts import find_unsure, of_row, rounded
from cotton3dg.schemas.scale import ScaleInfo
from cotton3dg.stage import STAGES

SURE = {
    "boll_count": "14", "boll_count_low": "13", "boll_count_high": "15",
    "boll_volume_cm3": "700", "boll_volume_low_cm3": "665", "boll_volume_high_cm3": "735",
    "plant_height_cm": "80", "plant_height_low_cm": "79.6", "plant_height_high_cm": "80.4",
    "canopy_size_cm": "30", "canopy_size_low_cm": "29.7", "canopy_size_high_cm": "30.3",
}  # fmt: skip


def facts(**cells: str) -> Facts:
    return Facts("plant_017", (), "", "standard", {**SURE, **cells}, [], {}, None, None, None, None, None, None, None)


def verdict(**cells: str) -> dict[str, str]:
    return give_verdict(facts(**cells), "")


def test_narrow_intervals_and_no_flag_pass() -> None:
    assert verdict() == {"verdict": "green", "text": "All checks passed"}


@pytest.mark.parametrize(
    ("cells", "words"),
    [
        ({"boll_volume_low_cm3": "595", "boll_volume_high_cm3": "805"}, "boll volume ± 15 %"),
        ({"canopy_size_high_cm": "31.5"}, "canopy size ± 3 %"),
        ({"plant_height_low_cm": "77.2"}, "plant height ± 2 %"),
        ({"boll_count_low": "10", "boll_count_high": "18"}, "boll count ± 29 %"),
    ],
)
def test_a_wide_interval_is_told(cells: dict[str, str], words: str) -> None:
    assert verdict(**cells) == {"verdict": "yellow", "text": f"Less sure than usual: {words}"}


@pytest.mark.parametrize(
    ("low", "high", "sure"), [("190", "210", "green"), ("170", "230", "yellow"), ("120", "280", "red"), ("", "", "")]
)
def test_a_mark_on_the_card_says_how_sure_a_trait_is(low: str, high: str, sure: str) -> None:
    cells = {"boll_volume_cm3": "200", "boll_volume_low_cm3": low, "boll_volume_high_cm3": high}
    card = trait_cards(facts(**cells))[1]
    assert card["sure"] == sure and ("±" in card["sureness"]) == (sure in ("yellow", "red"))
    assert bool(find_unsure({**SURE, **cells})) == (sure in ("yellow", "red"))


def test_lengths_by_an_assumed_table_are_less_sure_than_usual() -> None:
    cells = {**SURE, "qc_flags": "orbit_gap|table_size_assumed"}
    sure = {card["name"]: (card["sure"], card["sureness"]) for card in trait_cards(facts(**cells))}
    assert sure.pop("Bolls")[0] == "green"
    assert {mark for mark, _ in sure.values()} == {"yellow"}
    assert all(words.endswith("table assumed") for _, words in sure.values())


def test_what_is_blank_or_sure_to_one_boll_is_not_unsure() -> None:
    few = {"boll_count": "5", "boll_count_low": "4", "boll_count_high": "6"}
    assert find_unsure(few) == find_unsure({}) == find_unsure({**SURE, "boll_volume_low_cm3": ""}) == []


def test_the_card_tells_what_halves_of_the_images_count() -> None:
    with_halves, without = (
        trait_cards(facts(**cells))[0] for cells in ({"boll_count_odd": "14", "boll_count_even": "15"}, {})
    )
    assert (with_halves["note"], without["note"]) == ("halves of the images count 14 and 15", "")
    assert with_halves["range"] == "13 to 15"


def test_an_unsure_count_names_the_bolls_that_make_it_so() -> None:
    confidences = ("0.98", "0.81", "0.90", "0.40", "")
    bolls = [{"boll_id": str(n), "qc_flags": "", "confidence": p} for n, p in enumerate(confidences, 1)]

    def note(flags: str = "", **cells: str) -> str:
        return trait_cards(replace(facts(qc_flags=flags, **cells), bolls=bolls))[0]["note"]

    unsure = {"boll_count": "14", "boll_count_low": "10", "boll_count_high": "18"}
    named = "none doubtful; least sure: boll 4 (40 %), boll 2 (81 %)"
    assert note(**unsure) == note("touching_bolls") == named
    assert note() == "none doubtful"
    bolls[:] = bolls[:1]
    assert note(**unsure) == "none doubtful"


def test_what_does_not_hang_on_the_plant_is_in_no_card() -> None:
    boll = {"boll_id": "1", "alpha_volume_cm3": "50", "qc_flags": ""}
    thing = {"boll_id": "2", "alpha_volume_cm3": "400", "qc_flags": "off_plant|too_large"}
    bolls, volume = trait_cards(replace(facts(boll_volume_mean_cm3="52"), bolls=[boll, thing]))[:2]
    assert bolls["note"].startswith("none doubtful")
    assert volume["note"] == "52.0 cm³ a boll; 50 cm³ without hollows"


def test_the_table_stands_on_the_cards_of_what_rests_on_it() -> None:
    scale = ScaleInfo("table", table_cm=(120.0, 60.0), table_assumed=True)
    _, *metric = trait_cards(replace(facts(), scale=scale))
    assert all("table taken as 120 x 60 cm" in card["note"] for card in metric)
    given = trait_cards(replace(facts(), scale=replace(scale, table_assumed=False)))
    assert "table of 120 x 60 cm" in given[2]["note"]
    assert "table" not in trait_cards(replace(facts(), scale=ScaleInfo("card")))[1]["note"]


def test_a_plant_without_bolls_has_no_volume_on_its_card() -> None:
    cards = trait_cards(facts(boll_count="0", boll_volume_cm3="", boll_volume_low_cm3="", boll_volume_high_cm3=""))
    assert (cards[0]["value"], cards[1]["value"], cards[1]["note"]) == ("0", "–", "no boll to measure")


def test_flags_and_doubtful_bolls_make_a_row_yellow() -> None:
    assert of_row([], 0, SURE) == ("green", "All checks passed")
    assert of_row(["orbit_gap"], 3, SURE) == ("yellow", "Look before you use it: orbit gap")
    two, many = (of_row(["orbit_gap", "dark", "blurred", "close"][:n], 0, SURE)[1] for n in (2, 4))
    assert two.endswith(": orbit gap, dark") and many.endswith(": 4 quality flags")
    assert of_row([], 2, SURE) == ("yellow", "Good, but look at 2 doubtful bolls")
    assert of_row(["no_bolls"], 0, SURE) == ("yellow", "No bolls were found")


def test_numbers_are_rounded_as_they_are_written() -> None:
    """The binary 37.15 is a little less, and Python's own rounding makes 37.1 of it."""
    assert [rounded(37.15, 1), rounded(2.675, 2), rounded(0.5, 0), rounded(-0.25, 1)] == ["37.2", "2.68", "1", "-0.3"]
    assert trait_cards(facts(canopy_size_cm="37.15"))[3]["value"] == "37.2"
    assert format_figure("1234567.25") == "1\u202f234\u202f567.3"


@pytest.mark.parametrize("preset", PRESETS)
def test_a_preset_is_known_by_what_the_stages_recorded(preset: str) -> None:
    made = {stage: as_dict(resolve(stage, values)) for stage, values in values_of(preset).items()}
    assert preset_of(made) == preset
    if preset == "draft":
        made["train"]["steps"] += 1
        assert preset_of(made) == "standard"


def values_of(preset: str) -> dict[str, dict[str, object]]:
    return {stage: PRESET_VALUES[preset].get(stage, {}) for stage in STAGES}


def test_the_headline_names_a_preset_that_is_not_the_usual_one() -> None:
    assert write_headline(facts(seconds="60")).endswith("measured in 60 s")
    assert write_headline(replace(facts(seconds="60"), preset="draft")).endswith("measured in 60 s with draft")


def test_flags_about_bolls_name_them() -> None:
    places = {"1": 0.0, "2": 3.9, "3": 7.3, "4": 30.0}
    bolls = [
        {"boll_id": n, "x_cm": str(x), "y_cm": "0", "z_cm": "0", "diameter_cm": "4", "qc_flags": "", "volume_cm3": "30"}
        for n, x in places.items()
    ]
    plant = replace(facts(), bolls=bolls)
    assert flagged_bolls(plant, "touching_bolls") == "bolls 2 and 3, bolls 1 and 2"
    assert flagged_bolls(plant, "doubtful_bolls") == flagged_bolls(plant, "orbit_gap") == ""
    bolls[1] |= {"qc_flags": "off_plant"}
    bolls[3] |= {"qc_flags": "flat_points", "volume_cm3": ""}
    assert flagged_bolls(plant, "touching_bolls") == ""
    assert flagged_bolls(plant, "bolls_off_plant") == "boll 2"
    assert flagged_bolls(plant, "doubtful_bolls") == flagged_bolls(plant, "bolls_without_volume") == "boll 4"
    assert flagged_bolls(
        replace(plant, bolls=[bolls[3] | {"boll_id": str(n)} for n in range(11)]), "doubtful_bolls"
    ).endswith("boll 7 and 3 more")
    assert flagged_bolls(replace(plant, bolls=[]), "touching_bolls") == ""


def test_a_boll_that_a_person_merged_is_not_doubted_for_its_size() -> None:
    row = {"qc_flags": "large|few_views", "corrected": "merged"}
    assert boll_doubts(row).startswith("fewer than three images")
    assert boll_doubts({**row, "corrected": ""}).startswith("much larger than the others")
