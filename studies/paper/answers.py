"""The study's five questions, answered in plain sentences from the evaluations that there are."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from studies.paper.paper import PAPER_TABLE, REFERENCE_METHOD
from studies.paper.statistics import Interval
from studies.paper.table import MethodRow, velocity_text
from studies.paper.variants import VARIANTS

Rows = Mapping[str, MethodRow]
Speeds = Mapping[str, Mapping[str, float]]
"""Method to variant to the most that its kept policy holds [m/s]."""


@dataclass(frozen=True, kw_only=True)
class Evidence:
    """What the answers are made from.

    Attributes:
        rows: method to its row, only of those with evaluations.
        literal: the same of the trainings with the paper's preset.
        variants: speeds of the kept policies on other editions, in Drake, with flux weakening.
        comparators: names of other papers' methods.
    """

    rows: Rows
    literal: Rows
    variants: Speeds
    comparators: tuple[str, ...]


@dataclass(frozen=True, kw_only=True)
class Answer:
    """A question and what the data say."""

    question: str
    text: str


ENOUGH_SEEDS = 3
"""With two seeds each, chance alone puts both of one method before both of the other in one of six tries."""


def verdict(faster: Interval, seeds: int) -> str:
    """Whether a probability of improvement settles an order.

    Args:
        faster: the probability, with its interval.
        seeds: of the method that has fewer.
    """
    if not math.isfinite(faster.low) or seeds < ENOUGH_SEEDS:
        return f"open, with {seeds} {'seed' if seeds == 1 else 'seeds'}"
    return "settled" if faster.low > 0.5 or faster.high < 0.5 else "open"


def comparison(rows: Rows, other: str) -> str:
    """``sprint`` against another method in one sentence; that it is not trained where it is not."""
    missing = [name for name in (REFERENCE_METHOD, other) if name not in rows]
    if missing:
        return f"Not evaluated yet: {' and '.join(f'`{name}`' for name in missing)}."
    ours, theirs = rows[REFERENCE_METHOD], rows[other]
    text = (
        f"`{REFERENCE_METHOD}` holds {velocity_text(ours, ours.most_held)} m/s, "
        f"`{other}` {velocity_text(theirs, theirs.most_held)}"
    )
    gain = ours.most_held.center / theirs.most_held.center - 1.0
    if math.isfinite(gain):
        text += f": {100 * gain:+.1f} %"
    faster = theirs.reference_faster
    text += f"; a seed of `{REFERENCE_METHOD}` is the faster with probability {faster.text(2)}"
    return f"{text}: {verdict(faster, min(ours.seeds, theirs.seeds))}."


def confirmed(rows: Rows) -> str:
    """Which of the paper's orders the seeds confirm, contradict or leave open, in its first lines."""
    groups: dict[str, list[str]] = {"Confirmed": [], "Not confirmed": [], "Open": []}
    if REFERENCE_METHOD not in rows:
        return f"Not evaluated yet: `{REFERENCE_METHOD}`, with which all methods are compared."
    for method in PAPER_TABLE:
        if method == REFERENCE_METHOD or method not in rows:
            continue
        faster, seeds = rows[method].reference_faster, min(rows[method].seeds, rows[REFERENCE_METHOD].seeds)
        settled = verdict(faster, seeds) == "settled"
        name = "Open" if not settled else "Confirmed" if faster.center > 0.5 else "Not confirmed"
        groups[name].append(f"`{method}`" + ("" if settled else f" ({_pairs(faster)})"))
    parts = [f"**{name}**: faster than {', '.join(found)}." for name, found in groups.items() if found]
    lead = f"In the paper `{REFERENCE_METHOD}` is faster than each of five other methods. On this robot:"
    return (
        f"{lead}\n\n{chr(10).join(f'- {part}' for part in parts)}"
        if parts
        else "No other method of the paper is trained yet."
    )


def _pairs(faster: Interval) -> str:
    """In how many pairs of seeds the reference method is the faster, in words."""
    if faster.center in (0.0, 1.0):
        return f"so far {'faster' if faster.center else 'slower'} in every pair of seeds"
    return f"so far faster in {100.0 * faster.center:.0f} % of the pairs of seeds"


def answers(evidence: Evidence) -> list[Answer]:
    """All five."""
    made: dict[str, Callable[[Evidence], str]] = {
        "Does the d-axis voltage matter, by how much, and for which motors?": _d_axis,
        "Does saturation matter?": lambda known: comparison(known.rows, "no-saturation"),
        "Does ACS help, for speed and for sureness?": _scheduling,
        "Does fixed acceleration collapse?": _collapse,
        "What does the best method of others reach on this robot?": _others,
    }
    return [Answer(question=question, text=make(evidence)) for question, make in made.items()]


def _d_axis(known: Evidence) -> str:
    text = comparison(known.rows, "simplified-dc") + _to_the_letter(known, "simplified-dc")
    for name in ("bp2-weak", "bp2-strong"):
        ours, theirs = (
            known.variants.get(method, {}).get(name, math.nan)
            for method in (REFERENCE_METHOD, "simplified-dc")
        )
        if math.isfinite(ours - theirs):
            text += (
                f" On the {VARIANTS[name].title} the kept policies, trained on the nominal robot, hold "
                f"{ours:.2f} and {theirs:.2f} m/s."
            )
        else:
            text += f" Not evaluated yet on the {VARIANTS[name].title}."
    return text


def _to_the_letter(known: Evidence, other: str) -> str:
    """The same comparison with the paper's reward table; that it is not trained where it is not."""
    if not {REFERENCE_METHOD, other} <= set(known.literal):
        return " With the paper's reward to the letter it is not evaluated yet."
    return f" With the paper's reward to the letter {comparison(known.literal, other)}"


def _scheduling(known: Evidence) -> str:
    text = comparison(known.rows, "uniform-commands")
    pair = [known.rows.get(name) for name in (REFERENCE_METHOD, "uniform-commands")]
    sure = [
        f"`{row.method}`: {row.collapsed} of {row.seeds} seeds collapsed, {row.falls.text(1)} falls of 10"
        for row in pair
        if row is not None
    ]
    text = f"For speed: {text} For sureness: {'; '.join(sure)}." if sure else text
    return text + _to_the_letter(known, "uniform-commands")


def _collapse(known: Evidence) -> str:
    parts = []
    for rows, preset in ((known.rows, "our reward"), (known.literal, "the paper's reward to the letter")):
        row = rows.get("fixed-acceleration")
        if row is None:
            parts.append(f"With {preset} it is not evaluated yet.")
        else:
            who = "the others hold" if row.collapsed else "they hold"
            held = f"; {who} {row.most_held.text(2)} m/s" if row.collapsed < row.seeds else ""
            parts.append(f"With {preset} {row.collapsed} of {row.seeds} seeds collapse{held}.")
    return " ".join(parts)


def _others(known: Evidence) -> str:
    found = [known.rows[name] for name in known.comparators if name in known.rows]
    running = [row for row in found if math.isfinite(row.most_held.center)]
    if not running:
        return "Not evaluated yet."
    best = max(running, key=lambda row: row.most_held.center)
    picked = (
        f"`{best.method}` is the fastest of {len(found)}. It was chosen for that, which the interval does "
        "not account for."
    )
    text = f"{picked} {comparison(known.rows, best.method)}"
    missing = [f"`{name}`" for name in known.comparators if name not in known.rows]
    return f"{text} Not evaluated yet: {', '.join(missing)}." if missing else text
