"""A recorded run as one interactive 3D page: what it is called, and where it lies."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sprintlab.core.errors import SprintlabError

if TYPE_CHECKING:
    from sprintlab.viewer.replay import ReplayText

RUNS = Path("runs")
_FIELDS: dict[str, tuple[type, ...]] = {
    "robot": (str,),
    "policy": (str,),
    "distance_m": (int, float),
    "sprint_time_s": (int, float),
    "time_100m_s": (int, float),
    "top_speed_command_m_s": (int, float),
    "audit": (dict,),
}
"""What the page takes from the numbers of a race; each may be missing or null."""


def trajectory_path(run: Path | None) -> Path:
    """The recorded trajectory of a run.

    Raises:
        SprintlabError: there is no such run, or none at all.
    """
    if run is None:
        races = sorted(RUNS.glob("race-*/trajectory.npz"), key=lambda path: path.stat().st_mtime)
        if not races:
            raise SprintlabError(f"there is no race in {RUNS}/ yet; run one with: sprintlab race")
        return races[-1]
    if not run.exists():
        raise SprintlabError(f"{run} does not exist; name the folder of a race or a trajectory (.npz)")
    return run / "trajectory.npz" if run.is_dir() else run


def race_result(path: Path) -> dict[str, Any]:
    """The numbers beside a trajectory; empty where there are none.

    Raises:
        SprintlabError: the file is there and is not what a race writes.
    """
    if not path.is_file():
        return {}
    try:
        numbers = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise SprintlabError(f"{path} cannot be read: {error}") from error
    if not isinstance(numbers, dict):
        raise SprintlabError(f"{path} is no result of a race")
    given = {name: value for name, value in numbers.items() if value is not None}
    for name, kinds in _FIELDS.items():
        if name in given and not isinstance(given[name], kinds):
            raise SprintlabError(f"{path} is no result of a race: {name} = {given[name]!r}")
    return given


def sprint_of(result: dict[str, Any]) -> tuple[float | None, float]:
    """Time [s], ``None`` where the distance was not reached, and distance [m] of a race's numbers."""
    return result.get("sprint_time_s", result.get("time_100m_s")), float(result.get("distance_m", 100.0))


def replay_text(trajectory: Path, robot: str, result: dict[str, Any]) -> ReplayText:
    """Heading and subtitle of the page."""
    from sprintlab.viewer.replay import ReplayText

    time, distance = sprint_of(result)
    sprint = trajectory.name == "trajectory.npz" and time is not None
    title = (
        f"{robot.upper()}: {distance:g} m in {time:.2f} s"
        if sprint
        else f"{robot.upper()}: {trajectory.stem}"
    )
    policy, top = result.get("policy"), result.get("top_speed_command_m_s")
    parts = [f"policy {policy}" if policy else "", f"command up to {top:g} m/s" if top else ""]
    audit = result.get("audit", {}).get("passed")
    parts.append("" if audit is None else "exploit audit passed" if audit else "exploit audit FAILED")
    return ReplayText(title=title, subtitle=", ".join(part for part in parts if part))


def write_race_replay(folder: Path, robot: str) -> None:
    """The 100 m as an interactive page beside the report."""
    from sprintlab.robots import load_robot
    from sprintlab.viewer.replay import load_arrays, write_replay

    trajectory = folder / "trajectory.npz"
    described = load_robot(robot)
    text = replay_text(trajectory, described.name, race_result(folder / "result.json"))
    write_replay(folder / "replay.html", load_arrays(trajectory), described, text)
