"""The table of a training, as wide as a terminal of 80 columns, and the same in a line."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping

from rich.console import Group, RenderableType
from rich.progress_bar import ProgressBar
from rich.rule import Rule
from rich.table import Table
from rich.text import Text

from sprintlab.core.text import number
from sprintlab.training.exam import GROUPS, LIMITS, LOAD_SHARE, MOST, REST_SPEED
from sprintlab.training.runs.stopwatch import PARTS

WIDTH = 79
_STEPS_PER_MINUTE = 3000.0
_TERMS = "reward/"
_LEAST_TERM = 5e-4
"""A term that contributes less to the reward of a second is not shown."""
_EXAM = (
    ("speed asked for [m/s]", "asked", 1.0, 2, ""),
    ("speed held [m/s]", "held", 1.0, 2, ""),
    ("fallen [%]", "fallen", 100.0, 0, f"at most {100.0 * (1.0 - MOST):.0f}"),
    (f"at rest, below {REST_SPEED:g} m/s [%]", "at_rest", 100.0, 0, f"at least {100.0 * MOST:.0f}"),
    ("foot force [body weights]", "foot_force", 1.0, 2, f"at most {LIMITS['foot_force']:g}"),
    ("pad deflection [mm]", "pad_deflection", 1e3, 1, f"at most {1e3 * LIMITS['pad_deflection']:g}"),
    ("gear torque [peak torques]", "gear_torque", 1.0, 2, f"at most {LIMITS['gear_torque']:g}"),
    ("joint speed [no-load speeds]", "joint_speed", 1.0, 2, f"at most {LIMITS['joint_speed']:g}"),
    ("depth in end stops [zones]", "stop_depth", 1.0, 2, ""),
    ("distance of two legs [mm]", "leg_distance", 1e3, 0, f"at least {1e3 * LIMITS['leg_distance']:g}"),
    ("least load of a foot [%]", "load", 100.0, 0, f"at least {100.0 * LOAD_SHARE:g}"),
    ("cost of transport", "cost", 1.0, 2, ""),
)
"""Rows of the exam: label, key of the log, factor, digits, limit."""


def clock(seconds: float) -> str:
    """``1:02:03`` or ``2:03``."""
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{rest:02d}" if hours else f"{minutes}:{rest:02d}"


def count(number: float) -> str:
    """A large number in three digits: ``12.3 M``."""
    for power, letter in ((1e9, " G"), (1e6, " M"), (1e3, " k")):
        if number >= power:
            return f"{number / power:.3g}{letter}"
    return f"{number:.3g}"


def plain_line(row: Mapping[str, float]) -> str:
    """One iteration in a line, for output that is no terminal."""
    broken = f", {row['broken']:.0f} broken" if row.get("broken") else ""
    return (
        f"iteration {row['iteration']:.0f}, {count(row['steps_per_second'])} steps/s, "
        f"reward {row['reward']:.3g}, speed {row['speed_median']:.2f} m/s, "
        f"fastest 5 % {row['speed_p95']:.2f}, commands up to {row['range_upper']:.1f}, "
        f"{_STEPS_PER_MINUTE * row['falls']:.2f} falls per minute{broken}"
    )


def plain_exam(row: Mapping[str, float]) -> str:
    """What an exam found, in a line."""
    held = (_held(row, name) for name in GROUPS)
    return f"exam at iteration {row['iteration']:.0f}, speed held: {', '.join(held)} m/s"


def _held(row: Mapping[str, float], group: str) -> str:
    """``12.31 of 14.5``, and how many limits failed."""
    failed = round(row[f"exam/{group}/limits_failed"])
    remark = f" ({failed} limit{'s' * (failed > 1)} failed)" if failed else ""
    return f"{number(row[f'exam/{group}/held'])} of {row[f'exam/{group}/asked']:.1f}{remark}"


def screen(
    title: str, row: Mapping[str, float], exam: Mapping[str, float], share: float, left: float, height: int
) -> RenderableType:
    """The table of a training.

    Args:
        exam: Numbers of the latest exam, and its iteration; empty before the first.
        left: Time until its end [s].
        height: Height of the terminal [lines]; reward terms are left out where they do not fit.
    """
    bar = ProgressBar(total=1.0, completed=share, width=WIDTH)
    parts: list[RenderableType] = [Rule(title, characters="─"), bar, _pairs(_general(row, left))]
    shown = [_rule(f"exam at iteration {exam['iteration']:.0f}"), _exam_table(exam)] if exam else []
    terms = list(_terms(row))
    lines = 2 + 9 + (len(_EXAM) + 2 if exam else 0) + 1 + (len(terms) + 1) // 2
    if lines < height:
        parts += [_rule("reward per second, by term"), _pairs(terms)]
    table = Table.grid(padding=0)
    table.width = WIDTH
    for part in (*parts, *shown):
        table.add_row(part)
    return Group(table)


def _rule(title: str) -> Rule:
    return Rule(title, characters="─", style="dim")


def _pairs(cells: Iterable[tuple[str, str]]) -> Table:
    """Names and values in two columns, the first column filled first."""
    items = list(cells)
    half = (len(items) + 1) // 2
    table = Table.grid(padding=(0, 1), expand=True)
    for _ in range(2):
        table.add_column(width=24, no_wrap=True, style="dim")
        table.add_column(width=13, no_wrap=True)
    for left, right in zip(items[:half], [*items[half:], ("", "")], strict=False):
        table.add_row(*left, *right)
    return table


def _general(row: Mapping[str, float], left: float) -> Iterator[tuple[str, str]]:
    yield "iteration", f"{row['iteration']:.0f}"
    yield "time left", clock(left)
    yield "policy steps", count(row["environment_steps"])
    yield "policy steps/s", count(row["steps_per_second"])
    for part in PARTS:
        yield f"  {part} alone", count(row[f"steps_per_second/{part}"])
    yield "reward per second", f"{row['reward']:.3f}"
    yield "episode length", f"{row['episode_length']:.1f} s"
    yield "falls per minute", f"{_STEPS_PER_MINUTE * row['falls']:.2f}"
    yield "speed, median", f"{row['speed_median']:.2f} m/s"
    yield "speed, fastest 5 %", f"{row['speed_p95']:.2f} m/s"
    yield "commands up to", f"{row['range_upper']:.2f} m/s"
    yield "speed error", f"{row['command_error']:.2f} m/s"
    yield "action noise", f"{row['action_std']:.3f}"


def _terms(row: Mapping[str, float]) -> Iterator[tuple[str, str]]:
    """What each term adds to the reward, the largest first."""
    found = {name: row[name] for name in row if name.startswith(_TERMS)}
    for name, value in sorted(found.items(), key=lambda item: -abs(item[1])):
        if abs(value) >= _LEAST_TERM:
            yield name.partition("/")[2].replace("_", " "), f"{value:+.3f}"


def _exam_table(exam: Mapping[str, float]) -> Table:
    table = Table.grid(padding=(0, 1), expand=True)
    table.add_column(ratio=3, no_wrap=True, style="dim")
    for _ in GROUPS:
        table.add_column(ratio=1, no_wrap=True, justify="right")
    table.add_column(ratio=1, no_wrap=True, style="dim", justify="right")
    for label, key, factor, digits, limit in _EXAM:
        values = (f"{factor * exam[f'exam/{name}/{key}']:.{digits}f}" for name in GROUPS)
        table.add_row(Text(label), *values, limit)
    failed = (exam[f"exam/{name}/limits_failed"] for name in GROUPS)
    marked = (f"[bold red]{number:.0f}[/]" if number else "[green]0[/]" for number in failed)
    table.add_row("limits failed", *marked, "")
    return table
