"""The race as a job: evaluate, draw, render, and write one folder that is complete or not there at all."""

from __future__ import annotations

import io
import platform
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
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
from sprintlab.evaluation.video import render_video
from sprintlab.robots import RobotDescription

SOFTWARE = ("sprintlab", "mujoco", "numpy", "onnxruntime")
_LONGEST_FACT = 2000  # characters
VIDEO_LEFT_OUT = "no video: it was not asked for"


def write_race(
    target: Path,
    result: RaceResult,
    robot: RobotDescription,
    table: str,
    facts: dict[str, str],
    video: bool,
    progress: Progress = lambda _: None,
) -> str:
    """Write the report of a race; returns one line that says why it has no video, empty where it has one.

    ``reserved_directory`` keeps the target free; ``table`` is the robot's name or the path of its parameter
    table; the facts are those of ``race_facts``.

    Raises:
        SprintlabError: the disk is full; nothing half-written is left.
    """
    with atomic_directory(target) as folder, ThreadPoolExecutor(1) as background:
        sprint, recording, film = result.sprint.trial, folder / "trajectory.npz", folder / "sprint.mp4"
        save_trajectory(recording, recorded(sprint), robot.joint_names)
        shot = (recording, film, table, sprint.hold_interval[1])
        rendering = background.submit(render_video, *shot) if video else None
        save_trajectory(folder / "profile.npz", recorded(representative(result.raw)), robot.joint_names)
        plan = planned_figures(result, robot)
        pictures = draw_pictures(plan, lambda title: progress(f"drawing: {title.lower()}"))
        for picture in pictures:
            atomic_write_bytes(folder / f"{picture.name}.png", picture.png)
        atomic_write_json(folder / "result.json", {**result.to_dict(), "facts": facts})
        progress("rendering the video")
        message = rendering.result() if rendering else VIDEO_LEFT_OUT
        mp4, rows = None if message else film.read_bytes(), list(facts.items())
        html = render_report(result, robot, pictures, rows, mp4, message, replay="replay.html")
        atomic_write_text(folder / "report.html", html)
    return message


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


def save_trajectory(path: Path, trajectory: Trajectory, joint_names: Sequence[str]) -> None:
    """Write every array of a trajectory and the names of its joints as compressed npz, in one step.

    Raises:
        SprintlabError: the disk refuses, or something that is no file has the name.
    """
    stream = io.BytesIO()
    arrays = {**trajectory.arrays(), "joint_names": np.array(joint_names)}
    np.savez_compressed(stream, **arrays)  # pyright: ignore[reportArgumentType]
    atomic_write_bytes(path, stream.getvalue())
