"""``python -m studies.paper verdicts``: the paper's five claims, each against the seeds of two methods."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import tyro

from sprintlab.cli.output import print_json
from studies.paper.paper import REFERENCE_METHOD
from studies.paper.record import DRAKE, NOMINAL, PLACES, PRESETS, RESULTS, Run, Runs, best_half, read_runs
from studies.paper.statistics import Interval, difference, improvement, interquartile_mean

SAME_SPEED = 0.2
"""Methods whose speeds differ by no more than this, with 95 % confidence, are equal [m/s]."""
LEAST_SEEDS, SEEDS, MOST_SEEDS = 5, 10, 20
"""With fewer than the first of one of the methods nothing is decided. Then it is decided by ten seeds, and by
twenty where ten leave it open; never between, where to stop when it suits would make verdicts by chance."""
CONFIRMED, REFUTED, OPEN = "confirmed", "refuted", "open"
FEW, NOT_RUN = "too few seeds", "not yet run"
EQUAL = f"equal within {SAME_SPEED:g} m/s"
PRESET_NAMES = {"sprintlab": "our reward", "paper": "the paper's reward"}


@dataclass(frozen=True, kw_only=True)
class Claim:
    """One claim of the paper: ``acs`` is faster than a method that lacks one part of it.

    Attributes:
        question: as the page asks it.
        part: what the other method lacks, for the table.
        other: the method without it.
        presets: reward tables with which it is asked.
    """

    question: str
    part: str
    other: str
    presets: tuple[str, ...] = PRESETS


CLAIMS = (
    Claim(
        question="Is a robot faster if its motors have a d-axis voltage in training?",
        part="the d-axis voltage",
        other="simplified-dc",
    ),
    Claim(
        question="Is it faster if training limits the torque at high joint speeds?",
        part="a torque-speed envelope",
        other="no-envelope",
    ),
    Claim(
        question="Is it faster if the commands of the training adapt to it (ACS)?",
        part="adaptive commands",
        other="uniform-commands",
    ),
    Claim(
        question="Does training fail if all commands rise with one acceleration?",
        part="free acceleration of the command",
        other="fixed-acceleration",
    ),
    Claim(
        question="Is it faster if its motors saturate in training?",
        part="saturation",
        other="no-saturation",
        presets=("sprintlab",),
    ),
    Claim(
        question="Is the whole method faster than the paper's baseline?",
        part="envelope and adaptive commands",
        other="baseline",
    ),
)


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """What the seeds say of ``acs`` against another method, with one reward table at one place.

    Attributes:
        ours: interquartile mean of the speeds of ``acs`` [m/s].
        theirs: that of the other method [m/s].
        gain: difference of both [m/s].
        faster: probability that a seed of ``acs`` is the faster one.
        seeds: seeds of both methods.
        said: ``CONFIRMED``, ``REFUTED``, ``EQUAL``, ``OPEN``, ``FEW`` or ``NOT_RUN``.
    """

    ours: Interval
    theirs: Interval
    gain: Interval
    faster: Interval
    seeds: tuple[int, int]
    said: str


def judge(runs: Runs, claim: Claim, preset: str, place: str = NOMINAL) -> Verdict:
    """The verdict by the speeds held while running."""
    return _judged(runs, claim, preset, lambda run: run.running(place), _fastest if place == DRAKE else list)


def judge_stopping(runs: Runs, claim: Claim, preset: str) -> Verdict:
    """The verdict by the speeds from which a policy also comes to rest, on the nominal robot."""
    return _judged(runs, claim, preset, Run.stopping, list)


def judge_audited(runs: Runs, claim: Claim, preset: str) -> Verdict:
    """The verdict by the speeds that pass the audit, on the nominal robot."""
    return _judged(runs, claim, preset, Run.audited, list)


def _fastest(group: Sequence[Run]) -> list[Run]:
    return best_half(group, lambda run: DRAKE in run.places)


def _judged(
    runs: Runs,
    claim: Claim,
    preset: str,
    speed: Callable[[Run], float],
    chosen: Callable[[Sequence[Run]], list[Run]],
) -> Verdict:
    pair = [runs.get((preset, method), ()) for method in (REFERENCE_METHOD, claim.other)]
    count = MOST_SEEDS if min(map(len, pair)) >= MOST_SEEDS else SEEDS
    groups = [chosen(group[:count]) for group in pair]
    ours, theirs = ([found for run in group if math.isfinite(found := speed(run))] for group in groups)
    gain, faster = difference(ours, theirs), improvement(ours, theirs)
    return Verdict(
        ours=interquartile_mean(ours),
        theirs=interquartile_mean(theirs),
        gain=gain,
        faster=faster,
        seeds=(len(ours), len(theirs)),
        said=FEW if 0 < min(len(ours), len(theirs)) < LEAST_SEEDS else verdict(gain, faster),
    )


def verdict(gain: Interval, faster: Interval) -> str:
    """What an interval of the difference [m/s] and one of the probability of improvement say."""
    if not math.isfinite(gain.center):
        return NOT_RUN
    if not math.isfinite(gain.low) or not math.isfinite(faster.low):
        return OPEN
    if gain.low >= -SAME_SPEED and gain.high <= SAME_SPEED:
        return EQUAL
    return CONFIRMED if faster.low > 0.5 else REFUTED if faster.high < 0.5 else OPEN


def verdict_rows(runs: Runs) -> list[tuple[str, ...]]:
    """One row per claim and reward table, in the columns of ``COLUMNS``."""
    rows = []
    for claim in CLAIMS:
        for preset in claim.presets:
            found = judge(runs, claim, preset)
            elsewhere = [judge(runs, claim, preset, place).said for place in PLACES[1:]]
            rows.append(
                (
                    f"`{claim.other}`: without {claim.part}",
                    PRESET_NAMES[preset],
                    found.said,
                    found.gain.text(1),
                    found.faster.text(2),
                    f"{found.seeds[0]} and {found.seeds[1]}",
                    judge_stopping(runs, claim, preset).said,
                    judge_audited(runs, claim, preset).said,
                    *elsewhere,
                )
            )
    return rows


COLUMNS = (
    "is `acs` faster than", "reward", "verdict", "difference [m/s]", "chance that a run of `acs` is faster",
    "runs", "stopping", "within the audit", "weak robot", "strong robot", "Drake",
)  # fmt: skip


def markdown_table(columns: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table in Markdown; cells are text."""
    return "\n".join(f"| {' | '.join(cells)} |" for cells in [columns, ["---"] * len(columns), *rows])


@dataclass(frozen=True, kw_only=True)
class Verdicts:
    """Print the verdict on each of the paper's claims, from the records.

    Attributes:
        results: folder of the records.
        json: print JSON only.
    """

    results: Path = RESULTS
    json: tyro.conf.FlagCreatePairsOff[bool] = False

    def run(self) -> int:
        """Read, judge, print."""
        runs = read_runs(self.results)
        if not self.json:
            print(markdown_table(COLUMNS, verdict_rows(runs)))
            return 0
        found: list[dict[str, Any]] = [
            {"claim": claim.part, "other": claim.other, "preset": preset, "place": place}
            | asdict(judge(runs, claim, preset, place))
            for claim in CLAIMS
            for preset in claim.presets
            for place in PLACES
        ]
        print_json(found)
        return 0
