"""``python -m studies.paper page``: the study's page and figure, whole, from the committed records."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from sprintlab.core.files import atomic_write_bytes, atomic_write_text
from studies.paper.figure import speeds_figure
from studies.paper.paper import PAPER_TABLE, REFERENCE_METHOD, REPORTED
from studies.paper.plan import LITERAL_ACS, NO_SATURATION, OTHERS, PRESETS, RESULTS, study_trainings
from studies.paper.record import Run, read_runs
from studies.paper.statistics import Interval, difference, improvement, interquartile_mean

Runs = Mapping[tuple[str, str], Sequence[Run]]
"""(preset, method) to its runs."""
SAME_SPEED = 0.2
"""Methods whose speeds differ by no more than this, with 95 % confidence, are equal [m/s]."""
PRESET_NAMES = {"sprintlab": "our reward", "paper": "the paper's reward"}


@dataclass(frozen=True, kw_only=True)
class Claim:
    """One claim of the paper: ``acs`` is faster than a method that lacks one part of it.

    Attributes:
        question: as the page asks it.
        part: what the other method lacks, for the table.
        other: the method without it.
    """

    question: str
    part: str
    other: str


CLAIMS = (
    Claim(question="Does the d-axis voltage in the motor model pay?", part="d-axis", other="simplified-dc"),
    Claim(question="Does any torque-speed envelope pay?", part="envelope", other="no-envelope"),
    Claim(question="Does adaptive command scheduling pay?", part="ACS", other="uniform-commands"),
    Claim(
        question="Does a fixed acceleration of the command fail?",
        part="not fixed",
        other="fixed-acceleration",
    ),
    Claim(question="Does saturation in the motor model pay?", part="saturation", other=NO_SATURATION),
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
        runs = grouped(read_runs(self.results))
        for suffix, image in speeds_figure(runs).items():
            atomic_write_bytes(self.figure.with_stem(self.figure.stem + suffix), image)
        atomic_write_text(self.output, page_text(runs, f"figures/{self.figure.name}"))
        print(self.output)
        return 0


def grouped(runs: Sequence[Run]) -> Runs:
    """Runs by preset and method, in the paper's order."""
    found: dict[tuple[str, str], list[Run]] = {}
    order = [*PAPER_TABLE, NO_SATURATION, LITERAL_ACS, *OTHERS]
    known = sorted({run.method for run in runs}, key=lambda name: (name not in order, *_place(order, name)))
    for preset in PRESETS:
        for method in known:
            chosen = [run for run in runs if (run.preset, run.method) == (preset, method)]
            if chosen:
                found[preset, method] = sorted(chosen, key=lambda run: run.seed)
    return found


def _place(order: Sequence[str], name: str) -> tuple[int, str]:
    return (order.index(name) if name in order else len(order)), name


def verdict(gain: Interval, faster: Interval) -> str:
    """What the seeds say of ``acs`` against another method.

    Args:
        gain: difference of the interquartile means [m/s].
        faster: probability that a seed of ``acs`` is the faster one.
    """
    if not math.isfinite(gain.low) or not math.isfinite(faster.low):
        return "open"
    if gain.low >= -SAME_SPEED and gain.high <= SAME_SPEED:
        return f"equal within {SAME_SPEED:g} m/s"
    return "confirmed" if faster.low > 0.5 else "refuted" if faster.high < 0.5 else "open"


def page_text(runs: Runs, figure: str) -> str:
    """The whole page in Markdown."""
    dark = figure.replace(".png", "-dark.png")
    parts = [
        "# The study of the six methods",
        "<!-- Written by `python -m studies.paper page`. -->",
        _lead(runs),
        verdict_table(runs),
        f'<picture><source media="(prefers-color-scheme: dark)" srcset="{dark}">'
        f'<img alt="Speed held while running, every seed of every method" src="{figure}"></picture>',
        "Every dot is a seed, the bar is the interquartile mean, the cross is what the paper reports.",
        "## The answers",
        *[_answer(runs, claim) for claim in CLAIMS],
        "## The paper's Table II and ours",
        method_table(runs, "sprintlab"),
        _NOTE,
        "## The paper's Table III and ours",
        reported_table(runs),
        "## Details",
        _folded("The six methods with the paper's reward table", method_table(runs, "paper")),
        _folded("Methods of other papers", method_table(runs, "sprintlab", others=True)),
        _folded("Median policies on the weak and strong edition and in Drake", variants_table(runs)),
        _folded("Every seed", seed_table(runs)),
        _folded("How to repeat it", _REPEAT),
    ]
    return "\n\n".join(part for part in parts if part) + "\n"


_NOTE = """Speeds in m/s, raw command. *Running*: the most that is held where nine of ten trials stay upright.
*Stopping*: the most that is held up to the first command from which fewer than nine of ten come to rest.
Brackets: 95 % bootstrap interval of the interquartile mean over seeds. J (over that of `acs`), 100 m and
audit: at the fastest command that the policy completes. The robot is a surrogate: compare orders and ratios,
not speeds."""
_REPEAT = """```sh
# the trainings that are missing, as commands
python -m studies.paper plan runs/study
# evaluate what is there, then the median policies elsewhere, then write this page
python -m studies.paper evaluate runs/study
python -m studies.paper variants runs/study
python -m studies.paper page
```

Every run is one file of a few kB in `studies/paper/results`; delete those of an earlier training before you
evaluate new ones."""


def _lead(runs: Runs) -> str:
    """Question and answer in a few sentences."""
    found = [row[-1] for row in _verdicts(runs)]
    trainings = study_trainings()
    missing = sum(
        each.seed not in {run.seed for run in runs.get((each.preset, each.method), ())} for each in trainings
    )
    bound = sum(run.ended_at_stopping for group in runs.values() for run in group)
    decided = len(found) - found.count("open")
    text = f"""The paper says that each part of its method makes the robot faster: the refined motor model,
its saturation, and adaptive command scheduling (ACS). On our surrogate robot, {decided} of {len(found)}
comparisons are decided."""
    if missing:
        text += f"\n{missing} of {len(trainings)} trainings are still missing, so the others stay open."
    if bound:
        text += f"\nThe search ended at stopping in {bound} runs, whose running speed is a lower bound."
    days = sorted(run.date[:10] for group in runs.values() for run in group)
    return text + (f"\nEvaluated from {days[0]} to {days[-1]}." if days else "")


def _verdicts(runs: Runs) -> list[tuple[str, ...]]:
    rows = []
    for claim in CLAIMS:
        for preset in PRESETS:
            ours, theirs = _speeds(runs, preset, REFERENCE_METHOD), _speeds(runs, preset, claim.other)
            if not ours or not theirs:
                continue
            gain, faster = difference(ours, theirs), improvement(ours, theirs)
            seeds = f"{len(ours)} and {len(theirs)}"
            cells = (interquartile_mean(ours).text(1), interquartile_mean(theirs).text(1), gain.text(1))
            name = f"{claim.part}: `{claim.other}`"
            rows.append((name, PRESET_NAMES[preset], *cells, faster.text(2), seeds, verdict(gain, faster)))
    return rows


def verdict_table(runs: Runs) -> str:
    """One row per claim and reward table."""
    head = (
        "`acs` is faster than",
        "with",
        "`acs` [m/s]",
        "the other [m/s]",
        "difference",
        "a seed of `acs` is the faster",
        "seeds",
        "verdict",
    )
    return markdown_table(head, [(*row[:-1], f"**{row[-1]}**") for row in _verdicts(runs)])


def _answer(runs: Runs, claim: Claim) -> str:
    """Three sentences that stand alone."""
    ours, theirs = (_speeds(runs, "sprintlab", name) for name in (REFERENCE_METHOD, claim.other))
    if not ours or not theirs:
        return f"**{claim.question}** Open: `{claim.other}` is not trained yet."
    found = verdict(difference(ours, theirs), improvement(ours, theirs))
    ours_text, theirs_text = (f"{interquartile_mean(each).center:.1f}" for each in (ours, theirs))
    held = (
        f"With our reward `acs` holds {ours_text} m/s and `{claim.other}` {theirs_text} m/s "
        f"(interquartile means of {len(ours)} and {len(theirs)} seeds)."
    )
    literal = _literal(runs, claim)
    paper = PAPER_TABLE.get(claim.other)
    if paper is None:
        reported = "The paper does not report it alone."
    elif paper.max_velocity is None:
        reported = "In the paper that method collapses."
    else:
        best = PAPER_TABLE[REFERENCE_METHOD].max_velocity
        reported = f"The paper reports {best:g} and {paper.max_velocity:g} m/s."
    return " ".join(
        part for part in (f"**{claim.question}** {found.capitalize()}.", held, literal, reported) if part
    )


def _literal(runs: Runs, claim: Claim) -> str:
    ours, theirs = (_speeds(runs, "paper", name) for name in (REFERENCE_METHOD, claim.other))
    if not ours or not theirs:
        return ""
    means = [f"{interquartile_mean(each).center:.1f}" for each in (ours, theirs)]
    return f"With the paper's reward it is {means[0]} and {means[1]} m/s."


def method_table(runs: Runs, preset: str, others: bool = False) -> str:
    """The paper's Table II with our columns; ``others``: the methods that it does not have."""
    head = (
        "method",
        "paper",
        "running",
        "stopping",
        "paper: J_norm",
        "J_norm",
        "100 m [s]",
        "seeds",
        "audit passed",
    )
    reference = _costs(runs.get((preset, REFERENCE_METHOD), ()))
    rows = []
    for (where, method), group in runs.items():
        if where != preset or (method in PAPER_TABLE) == others:
            continue
        paper = PAPER_TABLE.get(method)
        cost = _costs(group) / reference if reference else math.nan
        times = [run.fastest.sprint_time for run in group if run.fastest and run.fastest.sprint_time]
        rows.append(
            (
                f"`{method}`",
                _reported(paper.max_velocity if paper else math.nan, 1),
                interquartile_mean([run.running for run in group]).text(1),
                interquartile_mean([run.stopping for run in group]).text(1),
                _reported(paper.normalized_cost if paper else math.nan, 2),
                _reported(cost, 2),
                _reported(interquartile_mean(times).center, 1),
                str(len(group)),
                f"{sum(run.audit_passed for run in group)} of {len(group)}",
            )
        )
    return markdown_table(head, rows) if rows else ""


def reported_table(runs: Runs) -> str:
    """The paper's Table III as reported, and our row."""
    rows = [
        (name, *("-" if speed is None else f"{speed:g}" for speed in speeds), "reported")
        for name, *speeds in REPORTED
    ]
    ours = _speeds(runs, "sprintlab", REFERENCE_METHOD)
    if ours:
        rows.append(
            ("surrogate of BP2, `acs`", interquartile_mean(ours).text(1), "-", "ours, simulated only")
        )
    return markdown_table(("robot", "simulation [m/s]", "outdoors [m/s]", ""), rows)


def variants_table(runs: Runs) -> str:
    """Running speeds of the policies that ran elsewhere, too."""
    names = ("bp2-weak", "bp2-strong", "drake")
    rows = [
        (
            f"`{method}`, {PRESET_NAMES[preset]}",
            str(run.seed),
            f"{run.running:.1f}",
            *(_reported(run.variants.get(name, math.nan), 1) for name in names),
        )
        for (preset, method), group in runs.items()
        for run in group
        if run.variants
    ]
    head = ("policy", "seed", "nominal [m/s]", "weak [m/s]", "strong [m/s]", "Drake [m/s]")
    return markdown_table(head, rows) if rows else ""


def seed_table(runs: Runs) -> str:
    """One row per run."""
    head = (
        "method",
        "reward",
        "seed",
        "running",
        "stopping",
        "J",
        "stride [Hz]",
        "100 m [s]",
        "audit: failed",
    )
    rows = [
        (
            f"`{method}`",
            PRESET_NAMES[preset],
            str(run.seed),
            f"{run.running:.2f}",
            f"{run.stopping:.2f}",
            *_details(run),
        )
        for (preset, method), group in runs.items()
        for run in group
    ]
    return markdown_table(head, rows)


def _details(run: Run) -> tuple[str, ...]:
    if run.fastest is None:
        return ("-",) * 4
    numbers = (run.fastest.angular_cost, run.fastest.stride_frequency, run.fastest.sprint_time)
    cells = (_reported(math.nan if value is None else value, 1) for value in numbers)
    return (*cells, ", ".join(run.fastest.audit_failed) or "passed")


def markdown_table(columns: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table in Markdown; cells are text."""
    return "\n".join(f"| {' | '.join(cells)} |" for cells in [columns, ["---"] * len(columns), *rows])


def _speeds(runs: Runs, preset: str, method: str) -> list[float]:
    return [run.running for run in runs.get((preset, method), ())]


def _costs(group: Sequence[Run]) -> float:
    costs = [run.fastest.angular_cost for run in group if run.fastest and run.fastest.angular_cost]
    return interquartile_mean(costs).center


def _reported(value: float | None, digits: int) -> str:
    return "collapse" if value is None else f"{value:.{digits}f}" if math.isfinite(value) else "-"


def _folded(title: str, body: str) -> str:
    """A part that a reader opens."""
    return f"<details><summary>{title}</summary>\n\n{body}\n\n</details>" if body else ""
