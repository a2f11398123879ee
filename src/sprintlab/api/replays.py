"""``replay`` and ``play``: the robot in a browser, recorded or to be driven."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sprintlab import control
from sprintlab.api.policies import RobotChoice, default_robot, known_robot, policy_path
from sprintlab.api.results import Result
from sprintlab.core.arguments import checked
from sprintlab.core.errors import ContractMismatchError, InvalidValueError, SprintlabError
from sprintlab.core.extras import require_package
from sprintlab.core.files import atomic_write_text, check_writable_file
from sprintlab.core.joystick import DEFAULT_DEVICE
from sprintlab.core.reading import read_json, refused_as_damaged
from sprintlab.robots import RobotDescription, load_robot
from sprintlab.viewer import replay as replays
from sprintlab.viewer.replay import ReplayRun

if TYPE_CHECKING:
    from sprintlab.viewer.live import Session

RUNS = Path("runs")
RECORDING = "trajectory.npz"
_VERDICTS = {None: "", True: "exploit audit passed", False: "exploit audit FAILED"}


@checked
def replay(
    run_folders: Sequence[Path | str] = (),
    *,
    world_record: bool = False,
    robot: RobotChoice = None,
    output: Path | str | None = None,
) -> Result:
    """Write recorded runs as one HTML file: orbit, scrub, slow motion, speed and torque; opens offline.

    Several runs start together on neighbouring lanes, with the gaps between them as they run.
    Example: sprintlab replay lap.npz --world-record

    Args:
        run_folders: folders of races, or recorded trajectories (.npz); the newest race when left out.
        world_record: add a runner at the pace of the men's world record over the distance (100 or 400 m).
        robot: a robot's name or parameter table (.toml); what the race's result.json says when left out.
        output: the page to write; replay.html (several runs: ghosts.html) beside the first when left out.
    """
    if output is not None:
        check_writable_file(output)
    paths = [_trajectory_path(None if run is None else Path(run)) for run in run_folders or (None,)]
    results = [_race_result(path) for path in paths]
    runs = [_run(path, result, robot) for path, result in zip(paths, results, strict=True)]
    if replays.is_lap(runs[0].arrays):
        results[0].setdefault("distance_m", 400.0)
    (title, subtitle, distance), pace = _text(paths[0], runs[0].robot.name, results[0]), None
    if world_record and (pace := replays.WORLD_RECORDS.get(distance)) is None:
        known = " and ".join(f"{known:g} m" for known in replays.WORLD_RECORDS)
        raise InvalidValueError("world_record", f"{distance:g} m", f"records are known over {known}")
    alone = len(runs) == 1 and pace is None
    if not alone:
        against = " against ".join([*(run.name for run in runs), *(["the world record"] if pace else [])])
        title, subtitle = against, f"{distance:g} m"
    page = paths[0].with_name("replay.html" if alone else "ghosts.html") if output is None else Path(output)
    atomic_write_text(page, replays.render_replay(runs, title, subtitle, distance, pace))
    numbers = {"page": str(page), "bytes": page.stat().st_size}
    return Result(numbers=numbers, shown=[f"replay: {page}"], page=page)


def write_race_replay(folder: Path, robot: RobotDescription) -> None:
    """The 100 m of this robot as an interactive page beside the report."""
    path = folder / RECORDING
    run = ReplayRun(arrays=replays.load_arrays(path), robot=robot)
    page = replays.render_replay([run], *_text(path, robot.name, _race_result(path)))
    atomic_write_text(folder / "replay.html", page)


def _run(path: Path, result: dict[str, Any], robot: RobotChoice) -> ReplayRun:
    if robot is None and (named := result.get("robot")):
        robot = known_robot(str(named), "result.json")
    described = load_robot(robot or default_robot())
    name = str(result.get("policy", path.absolute().parent.name if path.name == RECORDING else path.stem))
    return ReplayRun(arrays=replays.load_arrays(path), robot=described, name=name)


def _trajectory_path(run: Path | None) -> Path:
    if run is None:
        races = sorted(RUNS.glob(f"race-*/{RECORDING}"), key=lambda path: path.stat().st_mtime)
        if not races:
            raise SprintlabError(f"there is no race in {RUNS}/ yet; run one with: sprintlab race")
        return races[-1]
    if not run.exists():
        raise SprintlabError(f"{run} does not exist; name the folder of a race or a trajectory (.npz)")
    return run / RECORDING if run.is_dir() else run


def _race_result(trajectory: Path) -> dict[str, Any]:
    """The numbers beside a trajectory; empty without them."""
    path = trajectory.with_name("result.json")
    if not path.is_file():
        return {}
    with refused_as_damaged(path, "is not the result of a race"):
        return {name: value for name, value in read_json(path, what="result").items() if value is not None}


def _text(trajectory: Path, robot: str, result: dict[str, Any]) -> tuple[str, str, float]:
    """Heading and subtitle of the page, and the distance that was run [m]."""
    with refused_as_damaged(trajectory.with_name("result.json"), "is not the result of a race"):
        distance, policy = float(result.get("distance_m", 100.0)), result.get("policy")
        time, top = (
            result.get("sprint_time_s", result.get("time_100m_s")),
            result.get("top_speed_command_m_s"),
        )
        sprint = trajectory.name == RECORDING and time is not None
        what = f"{distance:g} m in {time:.2f} s" if sprint else trajectory.stem
        parts = [f"policy {policy}" if policy else "", f"command up to {top:g} m/s" if top else ""]
        parts.append(_VERDICTS[result.get("audit", {}).get("passed")])
    return f"{robot.upper()}: {what}", ", ".join(filter(None, parts)), distance


@checked
def play(
    policies: Sequence[str] = (),
    *,
    robot: RobotChoice = None,
    host: str = "localhost",
    port: int = 8080,
    gamepad: bool = False,
    gamepad_device: Path = DEFAULT_DEVICE,
    duration: float | None = None,
) -> Result:
    """Drive a robot in the browser: speed, turns, pushes, slope, friction, payload, policy, motor model.

    Example: sprintlab play my-policy.onnx sprint --port 9000

    Args:
        policies: files or names of the policies that the page switches between; all that fit when left out.
        host: interface to listen on; 0.0.0.0 lets other machines in.
        port: first port to try.
        gamepad: drive with a gamepad too.
        gamepad_device: device file of the gamepad.
        duration: stop after this time [s]; runs until Ctrl-C when left out.
    """
    require_package("viser", extra="play", use="sprintlab play")
    from sprintlab.viewer.page import Page

    pad = gamepad_device if gamepad else None
    page = Page(live_session(policies, robot), host, port, duration, pad)
    shown = [f"open {page.address} in a browser; Ctrl-C ends it"]
    return Result(numbers={"address": page.address}, shown=shown, serve=page.run)


def live_session(names: Sequence[str], robot: RobotChoice) -> Session:
    """The running robot behind such a page, with the policies that it can switch between."""
    from sprintlab.viewer.live import Session

    chosen = names or sorted(control.shipped_policies(), key=lambda name: (name != "sprint", name))
    opened = dict[str, control.Policy]()
    for path in map(policy_path, chosen):
        label = path.stem if path.stem not in opened else f"{path.stem} ({len(opened) + 1})"
        opened[label] = control.load_policy(path)
    if robot is None:
        first, policy = next(iter(opened.items()))
        robot = known_robot(policy.contract.robot_name, first)
    described, fitting = load_robot(robot), dict(opened)
    if names:
        return Session(described, opened)
    for label, policy in opened.items():
        try:
            control.check_contract(policy.contract, described)
        except ContractMismatchError:
            del fitting[label]
    if not fitting:
        raise SprintlabError(
            f"no policy for robot {described.name} comes with the package; name a policy file"
        )
    return Session(described, fitting)
