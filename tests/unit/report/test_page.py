# SPDX-License-Identifier: Apache-2.0
"""What a report says at a glance: only a row that is as sure as usual has passed all checks."""

from dataclasses import replace

import pytest

from cotton3dg.report.facts import Facts
from cotton3dg.report.page import give_verdict, trait_cards
from cotton3dg.report.verdicts import find_unsure, of_row
from cotton3dg.schemas.scale import ScaleInfo

SURE = {
    "boll_count": "14", "boll_count_low": "13", "boll_count_high": "15",
    "boll_volume_cm3": "700", "boll_volume_low_cm3": "665", "boll_volume_high_cm3": "735",
    "plant_height_cm": "80", "plant_height_low_cm": "79.6", "plant_height_high_cm": "80.4",
    "canopy_size_cm": "30", "canopy_size_low_cm": "29.7", "canopy_size_high_cm": "30.3",
}  # fmt: skip


def facts(**cells: str) -> Facts:
    return Facts("plant_017", (), "", {**SURE, **cells}, [], {}, None, None, None, None, None, None, None)


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
    assert trait_cards(facts(**cells))[1]["sure"] == sure
    assert bool(find_unsure({**SURE, **cells})) == (sure in ("yellow", "red"))


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
    assert of_row(["orbit_gap"], 3, SURE) == ("yellow", "Look before you use it: 1 quality flag")
    assert of_row([], 2, SURE) == ("yellow", "Good, but look at 2 doubtful bolls")
    assert of_row(["no_bolls"], 0, SURE) == ("yellow", "No bolls were found")
