"""``sprintlab replay``: a recorded run as one interactive 3D page."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import tyro

from sprintlab.cli.output import print_json, stdout_console
from sprintlab.cli.race import default_robot
from sprintlab.core.errors import InvalidValueError, SprintlabError
from sprintlab.core.reading import read_json

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
    """Write recorded runs as one HTML file: orbit, scrub, slow motion, speed and torque; opens offline.

    Several runs start together on neighbouring lanes, with the gaps between them as they run.

    Attributes:
        run_folders: folders of races, or recorded trajectories (.npz); the newest race when left out.
        world_record: also a runner at the pace of the men's world record over the distance (100 or 400 m).
        names: what to call the runs, in their order; the policies' names when left out.
        robot: a robot's name or parameter table (.toml); what the race's result.json says when left out.
        out: the page to write; replay.html (several runs: ghosts.html) beside the first when left out.
        json: print JSON only.
    """

    run_folders: tyro.conf.Positional[tuple[Path, ...]] = ()
    world_record: tyro.conf.FlagCreatePairsOff[bool] = False
    names: tuple[str, ...] = ()
    robot: str | None = None
    out: Path | None = None
    json: tyro.conf.FlagCreatePairsOff[bool] = False

    def run(self) -> int:
        """Write the page; raises ``SprintlabError`` when there is no recording or it is another robot's."""
        from sprintlab.viewer.replay import write_replay

        paths = [trajectory_path(run) for run in self.run_folders or (None,)]
        if self.names and len(self.names) != len(paths):
            raise InvalidValueError("names", " ".join(self.names), f"one name for each of {len(paths)} runs")
        results = [race_result(path.with_name("result.json")) for path in paths]
        pace = record_pace(sprint_of(results[0])[1]) if self.world_record else None
        runs = [self._run(index, path, results[index]) for index, path in enumerate(paths)]
        text = replay_text(paths[0], runs[0].robot.name, results[0], runs[0].name)
        alone = len(runs) == 1 and pace is None
        if not alone:
            names = [*(run.name for run in runs), *(["the world record"] if pace else [])]
            text = replace(text, title=" against ".join(names), subtitle=f"{text.distance:g} m")
        page = self.out or paths[0].with_name("replay.html" if alone else "ghosts.html")
        write_replay(page, runs[0].arrays, runs[0].robot, text, runs[1:], pace)
        if self.json:
            print_json({"page": str(page), "bytes": page.stat().st_size})
        else:
            stdout_console().print(f"replay: {page}", soft_wrap=True)
        return 0

    def _run(self, index: int, path: Path, result: dict[str, Any]) -> Any:
        from sprintlab.robots import load_robot
        from sprintlab.viewer.replay import ReplayRun, load_arrays

        robot = load_robot(self.robot or str(result.get("robot") or default_robot()))
        name = self.names[index] if self.names else str(result.get("policy", path.parent.name))
        return ReplayRun(arrays=load_arrays(path), robot=robot, name=name)


def record_pace(distance: float) -> Any:
    """The pace of the men's world record over a distance [m].

    Raises:
        InvalidValueError: none is known over it.
    """
    from sprintlab.viewer.replay import WORLD_RECORDS

    if distance not in WORLD_RECORDS:
        known = " and ".join(f"{known:g} m" for known in WORLD_RECORDS)
        raise InvalidValueError("world_record", f"{distance:g} m", f"records are known over {known}")
    return WORLD_RECORDS[distance]


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
    numbers = read_json(path, what="result")
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


def replay_text(trajectory: Path, robot: str, result: dict[str, Any], runner: str = "") -> Any:
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
    subtitle = ", ".join(part for part in parts if part)
    return ReplayText(title=title, subtitle=subtitle, distance=distance, runner=runner)
