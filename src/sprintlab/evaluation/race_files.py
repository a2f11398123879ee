"""The race as a job: evaluate, draw, render, and write one folder that is complete or not there at all."""

from __future__ import annotations

import io
import platform
from datetime import datetime
from pathlib import Path

import numpy as np

from sprintlab.core.errors import printable
from sprintlab.core.extras import package_version
from sprintlab.core.files import (
    atomic_directory,
    atomic_write_bytes,
    atomic_write_json,
    atomic_write_text,
)
from sprintlab.evaluation.figures import recorded
from sprintlab.evaluation.report import (
    Progress,
    draw_pictures,
    planned_figures,
    render_report,
    representative,
)
from sprintlab.evaluation.results import RaceResult, Trajectory
from sprintlab.robots import RobotDescription

SOFTWARE = ("sprintlab", "mujoco", "numpy", "onnxruntime")
_LONGEST_FACT = 2000  # characters


def write_race(
    target: Path,
    result: RaceResult,
    robot: RobotDescription,
    facts: dict[str, str],
    progress: Progress = lambda _: None,
) -> None:
    """Write the report of a race.

    ``reserved_directory`` keeps the target free; the facts are those of ``race_facts``.

    Raises:
        SprintlabError: the disk is full; nothing half-written is left.
    """
    with atomic_directory(target) as folder:
        save_trajectory(folder / "trajectory.npz", recorded(result.sprint.trial))
        save_trajectory(folder / "profile.npz", recorded(representative(result.raw)))
        plan = planned_figures(result, robot)
        pictures = draw_pictures(plan, lambda title: progress(f"drawing: {title.lower()}"))
        for picture in pictures:
            atomic_write_bytes(folder / f"{picture.name}.png", picture.png)
        atomic_write_json(folder / "result.json", {**result.to_dict(), "facts": facts})
        html = render_report(result, robot, pictures, list(facts.items()), replay="replay.html")
        atomic_write_text(folder / "report.html", html)


def race_facts(policy: Path, result: RaceResult, command_line: str) -> dict[str, str]:
    """What it takes to repeat a race: command as typed, policy, training run, versions."""
    facts = {
        "command": command_line,
        "date": datetime.now().astimezone().isoformat(timespec="seconds"),
        "policy file": policy.name,
        **result.policy_facts,
        "versions": ", ".join(f"{name} {package_version(name)}" for name in SOFTWARE),
        "machine": f"Python {platform.python_version()}, {platform.platform()}",
    }
    return {name: printable(fact, _LONGEST_FACT) for name, fact in facts.items()}


def save_trajectory(path: Path, trajectory: Trajectory) -> None:
    """Write every array of a trajectory as compressed npz, in one step.

    Raises:
        SprintlabError: the disk refuses, or something that is no file has the name.
    """
    stream = io.BytesIO()
    np.savez_compressed(stream, **trajectory.arrays())  # pyright: ignore[reportArgumentType]
    atomic_write_bytes(path, stream.getvalue())
