"""``python -m studies.paper page``: the study's page and figure, whole, from the committed records."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from sprintlab.core.files import atomic_write_bytes, atomic_write_text
from studies.paper.evaluate import FIRST_STEP, GRID, LIKELY, SEEDS_ELSEWHERE, TRIALS
from studies.paper.figure import speeds_figure
from studies.paper.paper import PAPER_TABLE, REFERENCE_METHOD, REPORTED
from studies.paper.plan import ENVIRONMENTS, ITERATIONS, LITERAL_ACS, NO_SATURATION, OTHERS, study_trainings
from studies.paper.record import NOMINAL, PLACES, PRESETS, RESULTS, Run, Runs, median_run, read_runs
from studies.paper.statistics import interquartile_mean
from studies.paper.verdicts import (
    CLAIMS,
    COLUMNS,
    CONFIRMED,
    EQUAL,
    FEW,
    LEAST_SEEDS,
    NOT_RUN,
    OPEN,
    PRESET_NAMES,
    REFUTED,
    SAME_SPEED,
    Claim,
    Verdict,
    judge,
    judge_audited,
    markdown_table,
    verdict_rows,
)


@dataclass(frozen=True, kw_only=True)
class Page:
    """Write the study's page from the committed records.

    Attributes:
        results: folder of the records.
        output: the page.
        figure: its figure; the dark one gets ``-dark`` before its ending.
    """

    results: Path = RESULTS
    output: Path = Path("docs/study.md")
    figure: Path = Path("docs/figures/study.png")

    def run(self) -> int:
        """Read, draw, write.

        Raises:
            SprintlabError: a record is damaged, or the disk refuses.
        """
        runs = read_runs(self.results)
        if runs:
            for suffix, image in speeds_figure(runs).items():
                atomic_write_bytes(self.figure.with_stem(self.figure.stem + suffix), image)
        atomic_write_text(self.output, page_text(runs, f"figures/{self.figure.name}"))
        print(self.output)
        return 0


def page_text(runs: Runs, figure: str) -> str:
    """The whole page in Markdown."""
    dark = figure.replace(".png", "-dark.png")
    picture = f"""<picture><source media="(prefers-color-scheme: dark)" srcset="{dark}">\
<img alt="Speed held while running, every seed of every method" src="{figure}"></picture>

Every dot is a seed, the bar is the interquartile mean, the cross is what the paper reports."""
    parts = [
        "# The study of the six methods",
        "<!-- Written by `python -m studies.paper page`. -->",
        _lead(runs),
        markdown_table(COLUMNS, verdict_rows(runs)),
        _VERDICTS,
        picture if runs else "",
        "## The answers",
        *[_answer(runs, claim) for claim in CLAIMS],
        "## The paper's Table II and ours",
        _compared_table(runs),
        _table_two_found(runs),
        _NOTE,
        "## The paper's Table III and ours",
        reported_table(runs),
        "## Details",
        _folded("The six methods with our reward", method_table(runs, "sprintlab", tuple(PAPER_TABLE))),
        _folded("The six methods with the paper's reward", method_table(runs, "paper", tuple(PAPER_TABLE))),
        _folded("Other methods, with our reward", method_table(runs, "sprintlab", (NO_SATURATION, *OTHERS))),
        _folded("ACS as printed, with the paper's reward", method_table(runs, "paper", (LITERAL_ACS,))),
        _folded("What the other methods change", _OTHER_METHODS),
        _folded("Median policies elsewhere", medians_table(runs)),
        _folded("Every seed", seed_table(runs)),
        _folded("How to repeat it", _REPEAT),
    ]
    return "\n\n".join(part for part in parts if part) + "\n"


_VERDICTS = f"""*Confirmed* or *refuted*: the chance that a run of `acs` is the faster one is above or
below one half, with 95 % confidence. *Equal*: the difference is at most {SAME_SPEED:g} m/s, with 95 %
confidence. *Open*: none of these. With fewer than {LEAST_SEEDS} seeds of a method nothing is said. The
verdict is by the speed held while running; *stopping* is by the highest speed from which a policy also
comes to rest, and *within the audit* by the highest that passes the [audit](evaluation.md#exploit-audit).
On the weak and on the strong robot at least {SEEDS_ELSEWHERE} seeds of each method run; in Drake half of
all seeds, the fastest whose policies are kept. Each verdict stands for itself: of so many at 95 %, one or
another is wrong by chance."""
_NOTE = f"""Speeds in m/s. *Running*, which this table compares: the most that is held at a command at
which each of {TRIALS} trials stays upright. *Stopping*: the most that is held up to the first command
from which one of them does not come to rest. *Within the audit*: the most that is held at a command at
which every check of the audit passes, except for that of the policy's clock, which needs trials of its
own. Commands rise from {LIKELY:g} m/s by {FIRST_STEP:g} m/s, and by {GRID:g} m/s near the highest
running, stopping and audited speed; they begin lower where a policy falls, does not come to rest or fails
the audit there. Brackets: 95 % bootstrap interval of the interquartile mean over seeds. J_norm is the
angular cost over that of `acs`; it and the time over 100 m are those at the command at which most is
held. The robot is a surrogate: compare orders and ratios, not speeds."""
_OTHER_METHODS = """| method | after | what differs from `acs` |
| --- | --- | --- |
| `no-saturation` | | motors that do not saturate in training |
| `literal-acs` | the paper | ACS as printed: no targets that the commands move toward |
| `rlvrl` | Margolis et al. 2022 | targets from a box-adaptive grid, commanded at once for 10 s |
| `lp-acrl` | 2601.17428 | bins drawn by learning progress |
| `hound` | 2312.17507 | v_d = 0 motor, gait and foot rewards, uniform commands with a ramp of 1 s |
| `spot-battery` | 2504.17857 | a battery behind the bus in training |
| `flux-weakening` | the paper's outlook | drives that weaken the flux in training, not when judged |"""
_REPEAT = """```sh
# the trainings that are missing, as commands
python -m studies.paper plan runs/study
# work them down on all GPUs for an hour, three at a time on each; given again, it goes on
python -m studies.paper train runs/study --minutes 60
# beside it: run what is trained and what will be within the hour
python -m studies.paper evaluate runs/study --minutes 60 --places bp2 bp2-weak bp2-strong
# run what is trained, in Drake as well; print the verdicts, write this page
python -m studies.paper evaluate runs/study
python -m studies.paper verdicts
python -m studies.paper page
# the kept policies, nearest to the median of each method, once more, to compare with the records
python -m studies.paper evaluate studies/paper/results --results again --places bp2
```

Every run is one file of a few kB in `studies/paper/results`."""


def _lead(runs: Runs) -> str:
    """Question and findings in a few sentences."""
    trainings, done = study_trainings(runs), sum(map(len, runs.values()))
    best, more = PAPER_TABLE[REFERENCE_METHOD].max_velocity, len(trainings) - done
    text = f"""The paper trains its robot with a refined motor model and with commands that adapt to it
(ACS). It reports {best:g} m/s, more than with any part of the method left out. Here every variant is
trained again for a simulated stand-in of its robot, up to ten times, with our reward table and with the
paper's. `acs` is the whole method; [what the other names mean](train.md#compare-methods)."""
    if not done:
        return f"{text} **Not yet run**: all {len(trainings)} trainings are missing."
    policies = [run for (_, method), group in runs.items() if method == REFERENCE_METHOD for run in group]
    passed = sum(run.fastest is not None and not run.fastest.audit_failed for run in policies)
    return f"""{text}

By the highest speeds that the policies run at all, `acs` is

{_found(runs, judge)}

At these speeds {passed} of the {len(policies)} policies of `acs` keep the limits of the
[audit](evaluation.md#exploit-audit). By the highest speeds that pass it, `acs` is

{_found(runs, judge_audited)}

{done} trainings of {ITERATIONS} iterations and {ENVIRONMENTS} robots are evaluated; {more} more are
planned, for open comparisons and other methods. What a wrong motor model costs who [chooses gears and
winding](speed-limit.md#choosing-gears-and-winding) is a study of its own."""


def _found(runs: Runs, decide: Callable[[Runs, Claim, str], Verdict]) -> str:
    """A line for each kind of verdict, with the methods that it is said of and their rewards."""
    found = dict[str, dict[str, list[str]]]()
    for claim in CLAIMS:
        for preset in claim.presets:
            said = decide(runs, claim, preset).said
            found.setdefault(said, {}).setdefault(claim.other, []).append(preset)
    return "\n".join(
        f"- {_LED_BY[said]} "
        + ", ".join(f"`{other}` ({_rewards(presets)})" for other, presets in those.items())
        for said, those in sorted(found.items(), key=lambda each: list(_LED_BY).index(each[0]))
    )


_LED_BY = {
    CONFIRMED: "**faster** than",
    EQUAL: f"**as fast**, within {SAME_SPEED:g} m/s, as",
    REFUTED: "**slower** than",
    OPEN: "perhaps faster (**open**) than",
    FEW: "not yet compared, for too few seeds, with",
    NOT_RUN: "not yet compared with",
}
"""How a line of a kind of verdict begins."""


def _rewards(presets: Sequence[str]) -> str:
    return "both rewards" if len(presets) == len(PRESETS) else PRESET_NAMES[presets[0]]


def _answer(runs: Runs, claim: Claim) -> str:
    """Three sentences that stand alone, and one where trainings collapse."""
    verdicts = {PRESET_NAMES[preset]: judge(runs, claim, preset) for preset in claim.presets}
    found = {each.said: reward for reward, each in verdicts.items()}
    both = len(found) < len(verdicts)
    said = ", ".join(f"{each} with {'both rewards' if both else reward}" for each, reward in found.items())
    held = "; ".join(
        f"with {reward} `acs` holds {each.ours.center:.1f} m/s and `{claim.other}` "
        f"{each.theirs.center:.1f} m/s"
        for reward, each in verdicts.items()
        if min(each.seeds) >= LEAST_SEEDS
    )
    sentences = [f"**{claim.question}** {_capitalized(said)}."]
    sentences += [f"{_capitalized(held)} (interquartile means)."] if held else []
    groups = [runs.get((preset, claim.other), ()) for preset in claim.presets]
    collapsed = [_collapsed(group, *each) for group, each in zip(groups, verdicts.items(), strict=True)]
    return " ".join([*sentences, *filter(None, collapsed), _paper_says(claim)])


def _collapsed(group: Sequence[Run], reward: str, found: Verdict) -> str:
    """How many trainings of a method hold less than half of what ``acs`` does; nothing if none."""
    count = sum(run.running() < 0.5 * found.ours.center for run in group)
    if not count:
        return ""
    return f"With {reward} {count} of its {len(group)} trainings collapse, to less than half of the speed."


def _paper_says(claim: Claim) -> str:
    paper = PAPER_TABLE.get(claim.other)
    if paper is None:
        return "The paper does not report it alone."
    if paper.max_velocity is None:
        return "In the paper that method collapses."
    best = PAPER_TABLE[REFERENCE_METHOD].max_velocity
    return f"The paper reports {best:g} and {paper.max_velocity:g} m/s."


def _capitalized(text: str) -> str:
    return text[:1].upper() + text[1:]


def _compared_table(runs: Runs) -> str:
    """The paper's Table II, and what we measure of it with both reward tables."""
    names = [PRESET_NAMES[preset] for preset in reversed(PRESETS)]
    speeds_of, costs_of = (f"{name} [m/s]" for name in names), (f"J_norm, {name}" for name in names)
    head = ("method", "paper [m/s]", *speeds_of, "J_norm, paper", *costs_of)
    rows = []
    for method, paper in PAPER_TABLE.items():
        speeds, costs = list[str](), list[str]()
        for preset in reversed(PRESETS):
            group, reference = (runs.get((preset, each), ()) for each in (method, REFERENCE_METHOD))
            speeds.append(_running(group))
            costs.append(_reported(_costs(group) / _costs(reference), 2))
        reported = (_reported(paper.max_velocity, 1), _reported(paper.normalized_cost, 2))
        rows.append((f"`{method}`", reported[0], *speeds, reported[1], *costs))
    return markdown_table(head, rows)


def _table_two_found(runs: Runs) -> str:
    """What the table above says of smoothness, and where the search ends."""
    others = [method for method in PAPER_TABLE if method != REFERENCE_METHOD]
    counts = []
    for preset in reversed(PRESETS):
        costs = [_costs(runs.get((preset, method), ())) for method in others]
        own = _costs(runs.get((preset, REFERENCE_METHOD), ()))
        counts.append(f"{sum(cost < own for cost in costs)} with {PRESET_NAMES[preset]}")
    paper = sum((row.normalized_cost or math.inf) < 1.0 for row in PAPER_TABLE.values())
    policies = [run for group in runs.values() for run in group]
    last = max((each.speed for run in policies for each in run.places[NOMINAL]), default=math.nan)
    cut = sum(run.fastest is not None and run.fastest.speed == last for run in policies)
    return f"""Of the {len(others)} other methods, {" and ".join(counts)} run smoother than `acs` (J_norm
below 1); in the paper {paper}. The search ends at a command of {last:g} m/s, more than any in training.
{cut} of {len(policies)} policies hold most there, so that their speeds are lower bounds."""


def method_table(runs: Runs, preset: str, methods: Sequence[str]) -> str:
    """All that we measure of some methods; a method without runs is said to be not yet run."""
    head = ("method", "running", "stopping", "within the audit", "J_norm", "100 m [s]", "seeds")
    reference = _costs(runs.get((preset, REFERENCE_METHOD), ()))
    rows = []
    for method in methods:
        group = runs.get((preset, method), ())
        times = [run.fastest.sprint_time for run in group if run.fastest and run.fastest.sprint_time]
        rows.append(
            (
                f"`{method}`",
                _running(group),
                interquartile_mean([run.stopping() for run in group]).text(1),
                interquartile_mean([run.audited() for run in group]).text(1),
                _reported(_costs(group) / reference, 2),
                _reported(interquartile_mean(times).center, 1),
                str(len(group)),
            )
        )
    return markdown_table(head, rows)


def reported_table(runs: Runs) -> str:
    """The paper's Table III as reported, and our row."""
    rows = [
        (name, *("-" if speed is None else f"{speed:g}" for speed in speeds), "reported")
        for name, *speeds in REPORTED
    ]
    group = runs.get(("sprintlab", REFERENCE_METHOD), ())
    rows.append(("surrogate of BP2, `acs`", _running(group), "-", "ours, simulated only"))
    if group:
        audited = interquartile_mean([run.audited() for run in group]).text(1)
        rows.append(("the same, audit passed", audited, "-", "ours, simulated only"))
    return markdown_table(("robot", "simulation [m/s]", "outdoors [m/s]", ""), rows)


def medians_table(runs: Runs) -> str:
    """Running speeds of each method's median policy at every place where it ran."""
    rows = []
    for (preset, method), group in runs.items():
        run = median_run(group)
        if run is not None:
            speeds = (_reported(run.running(place), 1) for place in PLACES)
            rows.append((f"`{method}`, {PRESET_NAMES[preset]}", str(run.seed), *speeds))
    head = ("policy", "seed", "nominal [m/s]", "weak [m/s]", "strong [m/s]", "Drake [m/s]")
    return markdown_table(head, rows) if rows else ""


def seed_table(runs: Runs) -> str:
    """One row per run."""
    head = (
        "method", "reward", "seed", "running", "stopping", "within the audit", "J", "stride [Hz]",
        "100 m [s]", "audit of running: failed",
    )  # fmt: skip
    rows = [
        (
            f"`{method}`",
            PRESET_NAMES[preset],
            str(run.seed),
            f"{run.running():.2f}",
            f"{run.stopping():.2f}",
            f"{run.audited():.2f}",
            *_details(run),
        )
        for (preset, method), group in runs.items()
        for run in group
    ]
    return markdown_table(head, rows) if rows else ""


def _details(run: Run) -> tuple[str, ...]:
    if run.fastest is None:
        return ("-",) * 4
    numbers = (run.fastest.angular_cost, run.fastest.stride_frequency, run.fastest.sprint_time)
    cells = (_reported(math.nan if value is None else value, 1) for value in numbers)
    return (*cells, ", ".join(run.fastest.audit_failed) or "passed")


def _running(group: Sequence[Run]) -> str:
    """Interquartile mean and interval of the running speeds."""
    return interquartile_mean([run.running() for run in group]).text(1) if group else NOT_RUN


def _costs(group: Sequence[Run]) -> float:
    costs = [run.fastest.angular_cost for run in group if run.fastest and run.fastest.angular_cost]
    return interquartile_mean(costs).center


def _reported(value: float | None, digits: int) -> str:
    return "collapse" if value is None else f"{value:.{digits}f}" if math.isfinite(value) else "-"


def _folded(title: str, body: str) -> str:
    """A part that a reader opens."""
    return f"<details><summary>{title}</summary>\n\n{body}\n\n</details>" if body else ""
