"""``sprintlab replay``: a recorded run as one interactive 3D page."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import tyro

from sprintlab.cli.output import print_json, stdout_console
from sprintlab.cli.race import default_robot
from sprintlab.core.errors import SprintlabError

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


@dataclass(frozen=True, kw_only=True)
class Replay:
    """Write a recorded run as one HTML file: orbit, scrub, slow motion, speed and torque; opens offline.

    Attributes:
        run_folder: folder of a race, or a recorded trajectory (.npz); the newest race in runs/ when left out.
        robot: a robot's name or parameter table (.toml); what the race's result.json says when left out.
        out: the page to write; replay.html beside the trajectory when left out.
        json: print JSON only.
    """

    run_folder: tyro.conf.Positional[Path | None] = None
    robot: str | None = None
    out: Path | None = None
    json: tyro.conf.FlagCreatePairsOff[bool] = False

    def run(self) -> int:
        """Write the page; raises ``SprintlabError`` when there is no recording or it is another robot's."""
        from sprintlab.robots import load_robot
        from sprintlab.viewer.replay import load_arrays, write_replay

        trajectory = trajectory_path(self.run_folder)
        result = race_result(trajectory.with_name("result.json"))
        arrays = load_arrays(trajectory)
        page = self.out or trajectory.with_name("replay.html")
        robot = load_robot(self.robot or str(result.get("robot") or default_robot()))
        write_replay(page, arrays, robot, replay_text(trajectory, robot.name, result))
        if self.json:
            print_json({"page": str(page), "bytes": page.stat().st_size})
        else:
            stdout_console().print(f"replay: {page}", soft_wrap=True)
        return 0


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


def replay_text(trajectory: Path, robot: str, result: dict[str, Any]) -> Any:
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
