"""What a training says at its end: speed and audit in the plant, and the command to type next."""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from rich.console import RenderableType

from sprintlab.api.races import audit_table
from sprintlab.core.errors import SimulationError, SprintlabError
from sprintlab.core.reading import read_rows
from sprintlab.evaluation import reached as trials
from sprintlab.evaluation.audit import audit_trials
from sprintlab.robots import load_robot

LOG_LIMIT = 64 << 20
"""Longest log of a training that is read [bytes]."""


def what_was_reached(folder: Path, robot: str | Path) -> Iterator[RenderableType]:
    """Run a few trials of a training's policy in the plant, and say what came of them."""
    log, policy = read_rows(folder / "log.jsonl", LOG_LIMIT), folder / "policy.onnx"
    try:
        found = trials.reached_speed(policy, load_robot(robot), asked_speed(log))
    except SimulationError as error:
        yield f"the trials in the plant failed: {error}"
        yield f"next: sprintlab race {shlex.quote(str(policy))}"
    except SprintlabError as error:
        yield str(error)
        longer = f"--minutes {max(1.0, log[-1]['seconds'] / 30.0):.0f}"
        yield f"next: sprintlab train --resume {longer} --output {shlex.quote(str(folder))}"
    else:
        reached, asked = found.running_speed, found.top_speed
        count = len(found.completed)
        yield f"reached {reached:.2f} m/s in the plant, asked for {asked:g} ({count} trials)"
        yield audit_table(audit_trials([trial.metrics for trial in found.trials]))
        yield f"next: sprintlab race {shlex.quote(str(policy))} --top-speed {asked:g}"


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
    speed = exams[-1]["exam/low/held"] if exams else log[-1]["speed_p95"] if log else 1.0
    return max(1.0, float(round(speed)))
