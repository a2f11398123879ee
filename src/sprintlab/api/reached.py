"""What a training says at its end: speed and audit in the plant, and the command to type next."""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import RenderableType

from sprintlab.api.results import styled, table
from sprintlab.core.errors import SimulationError, SprintlabError
from sprintlab.core.reading import read_rows

if TYPE_CHECKING:
    from sprintlab.evaluation.reached import Reached

_LOG_LIMIT = 64 << 20
_SLOWEST = 1.0


def what_was_reached(folder: Path, robot: str | Path) -> Iterator[RenderableType]:
    """Run a few trials of a training's policy in the plant, and say what came of them.

    Args:
        folder: of the run, with its log and its policy.
        robot: that was trained: name, folder or table.

    Raises:
        SprintlabError: the log cannot be read.
    """
    from sprintlab.evaluation.reached import reached_speed
    from sprintlab.robots import load_robot

    log, policy = read_rows(folder / "log.jsonl", _LOG_LIMIT), folder / "policy.onnx"
    speed = asked_speed(log)
    try:
        found = reached_speed(policy, load_robot(robot), speed)
    except SimulationError as error:
        yield f"the trials in the plant failed: {error}"
        yield f"next: sprintlab race {shlex.quote(str(policy))}"
        return
    except SprintlabError as error:
        yield str(error)
        longer = f"--minutes {max(1.0, log[-1]['seconds'] / 30.0):.0f}"
        yield f"next: sprintlab train --resume {longer} --output {shlex.quote(str(folder))}"
        return
    yield from _told(found)
    yield f"next: sprintlab race {shlex.quote(str(policy))} --top-speed {found.speed.top_speed:g}"


def asked_speed(log: Sequence[Mapping[str, float]]) -> float:
    """The speed [m/s] to ask a policy for: that at which it did best in an exam, else about what it runs."""
    exams = [row for row in log if "exam/held" in row]
    kept = [
        (row[f"exam/{group}/held"], row[f"exam/{group}/asked"])
        for row in exams
        for group in ("top", "middle", "low")
        if not row[f"exam/{group}/limits_failed"]
    ]
    if kept:
        return round(4.0 * max(kept)[1]) / 4.0
    speed = exams[-1]["exam/low/held"] if exams else log[-1]["speed_p95"] if log else _SLOWEST
    return max(_SLOWEST, float(round(speed)))


def _told(found: Reached) -> Iterator[RenderableType]:
    """The speed, and every line of the audit."""
    from sprintlab.evaluation.report_text import audit_limit, audit_measured, audit_verdict

    speed = found.speed
    yield (
        f"reached {speed.running_speed:.2f} m/s in the plant, asked for {speed.top_speed:g} "
        f"({len(speed.completed)} trials); audit {audit_verdict(found.audit)}"
    )
    columns = ("measured: median of the trials", "limit")
    verdicts = {True: styled("[green]pass[/]"), False: styled("[bold red]FAIL[/]")}
    rows = (
        (item.name, audit_measured(item), audit_limit(item), verdicts[item.passed])
        for item in found.audit.items
    )
    yield table("Audit", "what", *columns, "", numbers=columns, rows=rows)
