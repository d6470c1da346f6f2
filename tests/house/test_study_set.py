# SPDX-License-Identifier: Apache-2.0
"""The sets of simulated plants that judge: plants of their own, as their descriptions say."""

from __future__ import annotations

from same_boll_films import FITTED, JUDGED
from study_set import LOCKS, ODD, PLANTS, TOUCHING, natural


def value_of(options: str, flag: str) -> str | None:
    words = options.split()
    return words[words.index(flag) + 1] if flag in words else None


def test_no_two_plants_of_different_sets_share_a_seed() -> None:
    sets = [{value_of(options, "--seed") for options in some.values()} for some in (PLANTS, TOUCHING, ODD, LOCKS)]
    assert [len(seeds) for seeds in sets] == [12, 12, 12, 12]
    assert len(set().union(*sets)) == 48
    assert not sets[-1] & {value_of(options, "--seed") for options in natural(1).values()}


def test_what_a_fit_sees_is_in_no_set_that_judges() -> None:
    fitted, judged = ({value_of(options, "--seed") for options in some.values()} for some in (FITTED, JUDGED))
    studied = {value_of(options, "--seed") for some in (PLANTS, TOUCHING, ODD, LOCKS) for options in some.values()}
    assert (len(fitted), len(judged)) == (len(FITTED), len(JUDGED))
    assert not fitted & judged and not (fitted | judged) & studied


def test_half_of_the_plants_of_separate_locks_touch_and_half_have_one_window() -> None:
    films = LOCKS.values()
    assert all(value_of(options, "--boll-kind") == "separate" for options in films)
    assert sum("--clustered" in options for options in films) == 6
    assert sum("--one-sided" in options for options in films) == 6
    assert sum("--things" in options for options in films) == 6
    assert sum(name.startswith("hung-") for name in LOCKS) == 3
