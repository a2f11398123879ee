"""Recorded runs as one interactive 3D page: what it is called, and where it lies."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import RenderableType

from sprintlab.api.policies import RobotChoice, default_robot, known_robot
from sprintlab.api.tables import Printed
from sprintlab.core.arguments import checked
from sprintlab.core.errors import InvalidValueError, SprintlabError
from sprintlab.core.reading import read_json

if TYPE_CHECKING:
    from sprintlab.robots import RobotDescription
    from sprintlab.viewer.replay import ReplayRun, ReplayText

RUNS = Path("runs")
RECORDING = "trajectory.npz"
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


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class ReplayPage(Printed):
    """Recorded runs as one HTML file that opens offline."""

    path: Path
    """The file."""

    def to_dict(self) -> dict[str, Any]:
        """The page and its size [bytes]."""
        return {"page": str(self.path), "bytes": self.path.stat().st_size}

    def tables(self) -> Iterator[RenderableType]:
        """Where the page lies."""
        yield f"replay: {self.path}"

    def _repr_mimebundle_(self, **_: Any) -> dict[str, str]:
        """For notebooks: the page itself, inside of the cell."""
        page = escape(self.path.read_text(encoding="utf-8"))
        frame = f'<iframe srcdoc="{page}" width="100%" height="520" style="border: 0"></iframe>'
        return {"text/plain": str(self), "text/html": frame}


@checked
def replay(
    run_folders: Sequence[Path | str] = (),
    *,
    world_record: bool = False,
    names: Sequence[str] = (),
    robot: RobotChoice = None,
    output: Path | str | None = None,
) -> ReplayPage:
    """Write recorded runs as one HTML file: orbit, scrub, slow motion, speed and torque; opens offline.

    Several runs start together on neighbouring lanes, with the gaps between them as they run.

    Args:
        run_folders: folders of races, or recorded trajectories (.npz); the newest race when left out.
        world_record: also a runner at the pace of the men's world record over the distance (100 or 400 m).
        names: what to call the runs, in their order; the policies' names when left out.
        robot: a robot's name or parameter table (.toml); what the race's result.json says when left out.
        output: the page to write; replay.html (several runs: ghosts.html) beside the first when left out.

    Raises:
        SprintlabError: there is no recording, it is another robot's, or an option is refused.
    """
    from sprintlab.core.files import check_writable_file
    from sprintlab.viewer.replay import is_lap, write_replay

    if output is not None:
        check_writable_file(output)
    paths = [trajectory_path(None if run is None else Path(run)) for run in run_folders or (None,)]
    if names and len(names) != len(paths):
        raise InvalidValueError("names", " ".join(names), f"one name for each of {len(paths)} runs")
    results = [race_result(path.with_name("result.json")) for path in paths]
    runs = [_run(path, result, robot) for path, result in zip(paths, results, strict=True)]
    if is_lap(runs[0].arrays):
        results[0].setdefault("distance_m", 400.0)
    pace = record_pace(sprint_of(results[0])[1]) if world_record else None
    if names:
        runs = [replace(run, name=name) for run, name in zip(runs, names, strict=True)]
    text = replay_text(paths[0], runs[0].robot.name, results[0], runs[0].name)
    alone = len(runs) == 1 and pace is None
    if not alone:
        against = " against ".join([*(run.name for run in runs), *(["the world record"] if pace else [])])
        text = replace(text, title=against, subtitle=f"{text.distance:g} m")
    page = paths[0].with_name("replay.html" if alone else "ghosts.html") if output is None else Path(output)
    write_replay(page, runs[0].arrays, runs[0].robot, text, runs[1:], pace)
    return ReplayPage(path=page)


def _run(path: Path, result: dict[str, Any], robot: RobotChoice) -> ReplayRun:
    from sprintlab.robots import load_robot
    from sprintlab.viewer.replay import ReplayRun, load_arrays

    if robot is None and (named := result.get("robot")):
        robot = known_robot(named, path.with_name("result.json").name)
    described = load_robot(robot or default_robot())
    name = str(result.get("policy", path.absolute().parent.name if path.name == RECORDING else path.stem))
    return ReplayRun(arrays=load_arrays(path), robot=described, name=name)


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
    return run / RECORDING if run.is_dir() else run


def race_result(path: Path) -> dict[str, Any]:
    """The numbers beside a trajectory; empty without them.

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


def replay_text(trajectory: Path, robot: str, result: dict[str, Any], runner: str = "") -> ReplayText:
    """Heading and subtitle of the page."""
    from sprintlab.viewer.replay import ReplayText

    time, distance = sprint_of(result)
    sprint = trajectory.name == RECORDING and time is not None
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


def write_race_replay(folder: Path, robot: RobotDescription) -> None:
    """The 100 m of this robot as an interactive page beside the report."""
    from sprintlab.viewer.replay import load_arrays, write_replay

    trajectory = folder / RECORDING
    text = replay_text(trajectory, robot.name, race_result(folder / "result.json"))
    write_replay(folder / "replay.html", load_arrays(trajectory), robot, text)
