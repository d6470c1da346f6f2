# SPDX-License-Identifier: Apache-2.0
"""Fit the score that says which parts are one boll, `cotton3dg/cluster/same_boll.toml`, and judge it on other plants.

    python tests/accuracy/same_boll.py FOLDER [--jobs 2] [--only NAME ...] [--judge RUN[:TRUTH] ...] [--dry]

Plants that are not in FOLDER yet are filmed; all are run up to their masks, as far as they are not (--only: no others
than these). So the same command fits everything to a new network. --judge takes finished plants that the fit never
sees. Votes are kept in FOLDER/votes.

The weights are those of a logistic regression on pairs of parts as they are met while true bolls are put together.
Most of these pairs need not join for the boll to be one, as others will; so the constant is then moved to where the
bolls of the fitted plants come out best (F1). The share of a plant's parts that join others is the score's own, so both
are fitted in turns. All of that is done for each gain from which a part is split; the gain
that counts is the one that serves best kinds of plants that the fit leaves out, each kind in turn. Prints this choice;
what of these bolls comes true, by what it states; the score; and a row a plant: parts, true bolls, bolls found, and how
many of them are true (`evaluate`'s distance). Writes the table into the program (--dry: nowhere).
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
from markdown_tables import markdown
from same_boll_films import FITTED, JUDGED
from simulated_runs import film_and_run, side_by_side
from stored_votes import StoredVotes, open_votes
from true_scene import true_plant

from cotton3dg.cluster import boll_parts, join_parts
from cotton3dg.cluster.boll_parts import Part, gather_parts
from cotton3dg.cluster.hough_voting import Middles
from cotton3dg.cluster.join_parts import REACH_CM, find_near_pairs
from cotton3dg.cluster.same_boll import SCORE_FILE, Calibration, PairMeasures, Score, Term, log_odds
from cotton3dg.cluster.separate_bolls import Bolls, find_joining, find_peaks, guess_scale, join_bolls
from cotton3dg.cluster.split_parts import split_parts
from cotton3dg.evaluation.match import MATCH_DISTANCE_CM, match_bolls
from cotton3dg.io.saving import write_text_atomically

TERMS = {"sideways_cm": -1, "below_cm": -1, "two_middles": -1}
"""Measures, and whether more of it speaks for one boll or against."""
PURE = 0.6
"""Least share of a part's lint that is of one true boll, for the part to teach."""
CULTIVARS = (0.9, 1.0, 1.1)
"""How many times as large as the simulated ones bolls of other cultivars may be, or a scale be wrong."""
STIFFNESS = 1.0
"""Ridge, on the weights of measures of unit variance: as much as one example can say."""
SHIFTS = (0.0, -0.4, 0.4, -0.8, 0.8, -1.2, 1.2, -1.6, 1.6, -2.4, -3.2)
"""Log odds by which the constant may move."""

GAINS = (0.3, 0.2, 0.15)
"""Gains from which a part may be split; of equally good ones the first, which splits least."""
ROUNDS = 2
"""Number of fits after the first, each with the shares of joining parts that the one before finds."""
QUADRATURE = 15
"""Nodes of the integral over plants."""
DEVIATIONS = np.arange(0, 3.01, 0.05).round(2)
GROUPS = 5
"""Groups of bolls by what they state."""

Example = tuple[PairMeasures, float, bool]
"""What was measured of two parts, which share of their plant's parts joins others, and whether they are one boll."""


class Seen(NamedTuple):
    """A plant, by all views or by some."""

    stored: StoredVotes
    cm_per_su: float
    peaks: Middles
    """Where its votes meet, before any split."""


class Begun(NamedTuple):
    """A plant's parts before any join."""

    stored: StoredVotes
    cm_per_su: float
    parts: dict[int, Part]
    names: list[int]
    """True boll of each row, 0 = none's, -1 = of several."""


UNCALIBRATED = Calibration()
Film = Sequence[Begun]
"""A plant by all views, then by either half of them, as what half of the views say differs as another film would."""


def see(stored: StoredVotes) -> Seen:
    """Find where the votes meet."""
    return Seen(stored, stored.cm_per_su or guess_scale(stored.votes), find_peaks(stored.votes))


def begin(seen: Seen, split_gain: float) -> Begun:
    """Split the parts, and find what they are of."""
    stored = seen.stored
    middles, lint = split_parts(seen.peaks, stored.votes, split_gain), stored.lint.shares > 0.5
    owners, names = middles.nearest(stored.lint.gaussians.means[lint]), []
    for k in range(len(middles.centres)):
        counts = np.bincount(stored.true_ids[lint][owners == k + 1], minlength=1)
        names.append(int(counts.argmax()) if counts.max() >= PURE * counts.sum() > 0 else -1)
    return Begun(stored, seen.cm_per_su, gather_parts(middles, stored.votes, stored.lint), names)


def gather_examples(plant: Begun, joining: float) -> Iterator[Example]:
    """Pairs as they are met while the parts of true bolls join, the nearest first."""
    names, up, cm_per_su = plant.names, plant.stored.up, plant.cm_per_su
    parts = {row: part for row, part in plant.parts.items() if names[row] > 0}
    changed = set(parts)
    while True:
        near = find_near_pairs(parts, REACH_CM / cm_per_su)
        for a, b in near:
            if changed & {a, b}:
                yield join_parts.measure_pair(parts[a], parts[b], up, cm_per_su), joining, names[a] == names[b]
        same = [(a, b) for a, b in near if names[a] == names[b]]
        if not same:
            return
        a, b = min(same, key=lambda pair: float(np.linalg.norm(parts[pair[0]].centre - parts[pair[1]].centre)))
        parts[a], changed = join_parts.join_two(parts[a], parts.pop(b)), {a}


def fit(plants: Sequence[Sequence[Example]], split_gain: float) -> Score:
    """Logistic regression whose weights have the signs that physics gives them; each plant has the same say."""
    from scipy.optimize import minimize

    names, signs = [*TERMS, "joining"], [*TERMS.values(), 1]
    examples = [example for plant in plants for example in plant]
    say = np.concatenate([np.full(len(plant), len(examples) / len(plants) / max(len(plant), 1)) for plant in plants])
    say = np.tile(say, len(CULTIVARS)) / len(CULTIVARS)
    rows = np.array(
        [[*(getattr(each, name) for name in TERMS), each.two_middles * share] for each, share, _ in examples]
    )
    rows = np.concatenate([rows * [size if name.endswith("_cm") else 1 for name in names] for size in CULTIVARS])
    true = np.where(np.tile([so for *_, so in examples], len(CULTIVARS)), 1.0, -1.0)
    usual, spread = rows.mean(axis=0).round(3), rows.std(axis=0).clip(min=1e-9)
    rows = (rows - usual) / spread

    def loss(weights: np.ndarray) -> tuple[float, np.ndarray]:
        odds = true * (rows @ weights[1:] + weights[0])
        wrong = -say * true / (1 + np.exp(odds.clip(-50, 50)))
        ridge = STIFFNESS * np.append(0, weights[1:])
        return say @ np.logaddexp(0, -odds) + 0.5 * ridge @ weights, np.append(wrong.sum(), rows.T @ wrong) + ridge

    bounds = [(None, None), *((0, None) if sign > 0 else (None, 0) for sign in signs)]
    found = minimize(loss, np.zeros(len(names) + 1), jac=True, bounds=bounds, method="L-BFGS-B").x
    terms = zip(names, usual.tolist(), (found[1:] / spread).round(3).tolist(), strict=True)
    *pair, joining = (Term(*term) for term in terms)
    return Score(round(float(found[0]), 3), tuple(pair), joining, split_gain)


def hold_true(plant: Begun, bolls: Bolls) -> np.ndarray:
    """(B, T + 1) share of each true boll's lint that each boll holds; first, of its own lint, what is no boll's."""
    lint = plant.stored.lint.shares > 0.5
    held = np.zeros((len(bolls.centres) + 1, len(plant.stored.true_cm) + 1))
    np.add.at(held, (bolls.nearest(plant.stored.lint.gaussians.means[lint]), plant.stored.true_ids[lint]), 1)
    shares = held / held.sum(axis=0).clip(min=1)
    shares[:, 0] = held[:, 0] / held.sum(axis=1).clip(min=1)
    return shares[1:]


def is_thing(shares: np.ndarray) -> np.ndarray:
    """(B,) which bolls are white things, whatever they were put together of; another step finds them."""
    return shares[:, 0] > 0.5


def judge(plant: Begun, score: Score) -> dict[str, float]:
    """What a score makes of a plant."""
    found, similarity = join_bolls(plant.parts, plant.stored.up, plant.cm_per_su, score), plant.stored.cm_from_scene
    centres = found.centres[~is_thing(hold_true(plant, found))] @ similarity[:, :3].T + similarity[:, 3]
    right = len(match_bolls(centres, plant.stored.true_cm, MATCH_DISTANCE_CM))
    bolls = len(plant.stored.true_cm)
    return {"bolls": bolls, "found": len(centres), "right": right, "F1": 2 * right / (bolls + len(centres))}


def outcomes(plant: Begun, score: Score) -> Iterator[tuple[float, int]]:
    """Of each boll that a score makes: the probability that it is one, and how many true bolls have most of their lint
    in it. None has where it is a part of a boll."""
    found = join_bolls(plant.parts, plant.stored.up, plant.cm_per_su, score)
    shares = hold_true(plant, found)
    for stated, mine in zip(found.one_boll[~is_thing(shares)], shares[~is_thing(shares), 1:], strict=True):
        yield float(stated), int((mine > 0.5).sum())


def calibrate(score: Score, plants: Sequence[Begun]) -> Score:
    """The score whose probabilities of one boll are as often right as they say, over all plants."""
    from scipy.optimize import minimize

    pairs = [pair for plant in plants for pair in outcomes(plant, replace(score, one_boll=UNCALIBRATED))]
    pairs = [(stated, bolls) for stated, bolls in pairs if stated < 1]
    odds = np.array([log_odds(stated) for stated, _ in pairs])
    true = np.array([1.0 if bolls == 1 else -1.0 for _, bolls in pairs])

    def loss(values: np.ndarray) -> float:
        return np.logaddexp(0, -true * (values[0] + values[1] * odds)).sum() + 0.5 * STIFFNESS * (values[1] - 1) ** 2

    constant, slope = (
        minimize(loss, [0.0, 1.0], bounds=[(None, None), (0, None)], method="L-BFGS-B").x.round(3).tolist()
    )
    return replace(score, one_boll=Calibration(constant, slope))


def move_constant(score: Score, plants: Sequence[Begun]) -> Score:
    """The score with the constant that suits the plants best, as near to where it was as there is one."""
    moved = [replace(score, constant=round(score.constant + float(shift), 3)) for shift in SHIFTS]
    return max(moved, key=lambda one: round(float(np.mean([judge(plant, one)["F1"] for plant in plants])), 4))


def fit_score(films: Iterable[Film], split_gain: float) -> Score:
    """The score of some films, with its constant and its calibration."""
    films, score = list(films), None
    for _ in range(1 + ROUNDS):
        examples = [[pair for plant in film for pair in gather_examples(plant, share(plant, score))] for film in films]
        score = move_constant(fit(examples, split_gain), [film[0] for film in films])
    return calibrate(score, [plant for film in films for plant in film])


def share(plant: Begun, score: Score | None) -> float:
    """Share of a plant's parts that join others by a score; before any, it is the same for all plants."""
    return find_joining(plant.parts, plant.stored.up, plant.cm_per_su, score) if score else 0.0


def kind_of(name: str) -> str:
    """The kind of a film's bolls."""
    return name.rsplit("-", 1)[0]


def leave_out(films: Mapping[str, Film], split_gain: float) -> dict[str, Score]:
    """Kind -> the score of the films of all other kinds."""
    kinds = sorted({kind_of(name) for name in films})
    others = {kind: [film for name, film in films.items() if kind_of(name) != kind] for kind in kinds}
    return {kind: fit_score(others[kind], split_gain) for kind in kinds}


def judge_left_out(films: Mapping[str, Film], scores: Mapping[str, Score]) -> dict[str, float]:
    """Kind -> mean F1 of its films by the score of the others."""
    rows = {name: judge(film[0], scores[kind_of(name)])["F1"] for name, film in films.items()}
    return {kind: float(np.mean([f1 for name, f1 in rows.items() if kind_of(name) == kind])) for kind in scores}


def fit_deviation(plants: Iterable[Sequence[tuple[float, int]]]) -> float:
    """Standard deviation between plants of the log odds of one boll (`traits.count_distribution.COMMON_DEVIATION`).

    Maximum likelihood of a logistic normal model: each plant shifts the log odds that its bolls state by one number.

    Args:
        plants: `outcomes` of each, by a score that was fitted without its kind.
    """
    nodes, weights = np.polynomial.hermite_e.hermegauss(QUADRATURE)
    unsure = [[(log_odds(stated), bolls == 1) for stated, bolls in plant if stated < 1] for plant in plants]

    def likelihood(deviation: float) -> float:
        total = 0.0
        for plant in unsure:
            odds, one = np.array(plant, np.float64).reshape(-1, 2).T
            each = np.where(one > 0, 1, -1) * (odds + deviation * nodes[:, None])
            total += np.log(weights @ np.exp(-np.logaddexp(0, -each).sum(axis=1)))
        return total

    return float(max(DEVIATIONS, key=likelihood))


def reliability(pairs: Sequence[tuple[float, int]]) -> pd.DataFrame:
    """What comes true of what is stated, and which share is two bolls, in groups of equal size."""
    stated, bolls = np.array(sorted(pairs)).T
    groups = np.array_split(np.arange(len(stated)), GROUPS)
    return pd.DataFrame(
        {
            "stated": [stated[rows].mean() for rows in groups],
            "true": [(bolls[rows] == 1).mean() for rows in groups],
            "two": [(bolls[rows] > 1).mean() for rows in groups],
            "bolls": [len(rows) for rows in groups],
        }
    )


def calibration_error(table: pd.DataFrame) -> float:
    """Expected calibration error (Naeini et al. 2015)."""
    return float(np.average((table["stated"] - table["true"]).abs(), weights=table["bolls"]))


def write_score(path: Path, score: Score, films: int) -> None:
    """As a person reads it: a line a term."""
    lines = [
        "# Whether two parts are one boll: log odds = constant + sum of weight * (measure - usual). A weight is per",
        "# unit of its measure, cm where its name says so; what the measures are stands in same_boll.py.",
        f"# Fitted by `make same-boll` on {films} plants.",
        f"constant = {score.constant}",
        "terms = [",
        *(f'  {{ name = "{t.name}", usual = {t.usual}, weight = {t.weight} }},' for t in score.terms),
        "]",
        "# two_middles times the share of the plant's parts that join others.",
        f"joining = {{ usual = {score.joining.usual}, weight = {score.joining.weight} }}",
        "# A part is split if two middles explain its votes so much better than one (mean log likelihood of a vote).",
        f"split_gain = {score.split_gain}",
        "# Log odds of one boll of what was joined, by those that its pairs state.",
        f"one_boll = {{ constant = {score.one_boll.constant}, slope = {score.one_boll.slope} }}",
    ]
    write_text_atomically(path, "\n".join([*lines, ""]))


def main() -> None:
    # The same pairs are met again and again, for every score that is tried.
    for name in ("join_two", "measure_pair"):
        setattr(join_parts, name, cache(getattr(boll_parts, name)))
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--only", nargs="*", default=[*FITTED, *JUDGED], choices=[*FITTED, *JUDGED])
    parser.add_argument("--judge", nargs="*", type=true_plant, default=[], metavar="RUN[:TRUTH]")
    parser.add_argument("--dry", action="store_true")
    wanted = parser.parse_args()
    films = {name: film for name, film in (FITTED | JUDGED).items() if name in wanted.only}

    def film_one(name: str) -> int:
        return film_and_run(wanted.folder / name, films[name], "draft", until="masks")

    if failed := [n for n, code in zip(films, side_by_side(wanted.jobs, film_one, films), strict=True) if code]:
        sys.exit(f"failed: {', '.join(failed)}; see their logs in {wanted.folder}")
    plants = {name: true_plant(str(wanted.folder / name)) for name in films}
    plants |= {plant.run.plant_id: plant for plant in wanted.judge}
    fitted = [name for name in films if name in FITTED]
    stored = {name: open_votes(plant, wanted.folder / "votes") for name, plant in plants.items()}
    seen = {
        name: [see(one), *(see(replace(one, votes=one.votes[k::2])) for k in range(2 if name in fitted else 0))]
        for name, one in stored.items()
    }
    scores, rows = {}, {}
    for gain in GAINS:
        begun = {name: [begin(one, gain) for one in seen[name]] for name in fitted}
        scores[gain] = leave_out(begun, gain)
        rows[gain] = judge_left_out(begun, scores[gain])
    mean = {gain: round(float(np.mean(list(row.values()))), 3) for gain, row in rows.items()}
    gain = max(GAINS, key=lambda gain: mean[gain])
    table = pd.DataFrame([{"split_gain": gain, **row, "mean": mean[gain]} for gain, row in rows.items()])
    print("F1 of kinds that the fit left out:", markdown(table, 3), sep="\n")
    begun = {name: [begin(one, gain) for one in views] for name, views in seen.items()}
    of_plants = {name: list(outcomes(begun[name][0], scores[gain][kind_of(name)])) for name in fitted}
    left_out = {kind: [p for name in fitted if kind_of(name) == kind for p in of_plants[name]] for kind in scores[gain]}
    left_out["all"] = [pair for pairs in left_out.values() for pair in pairs]
    print("Bolls of these kinds:", markdown(reliability(left_out["all"]), 3), sep="\n")
    for kind, pairs in left_out.items():
        print(f"expected calibration error, {kind}: {calibration_error(reliability(pairs)):.3f}")
    print(f"standard deviation between plants of the log odds of one boll: {fit_deviation(of_plants.values()):.2f}")
    score = fit_score((begun[name] for name in fitted), gain)
    by_plant = [
        {"plant": name, "used": "to fit" if name in FITTED else "to judge", "parts": len(one[0].parts)}
        | judge(one[0], score)
        for name, one in begun.items()
    ]
    print(score, markdown(pd.DataFrame(by_plant), 3), sep="\n")
    if not wanted.dry:
        write_score(SCORE_FILE, score, len(fitted))


if __name__ == "__main__":
    main()
