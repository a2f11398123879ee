"""``replay`` and ``play``: the robot in a browser, recorded or to be driven."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sprintlab.api.policies import RobotChoice, default_robot, known_robot, load_policy, policy_path, robot_of
from sprintlab.api.results import Result
from sprintlab.core.arguments import checked
from sprintlab.core.errors import ContractMismatchError, InvalidValueError, SprintlabError
from sprintlab.core.extras import require_package
from sprintlab.core.joystick import DEFAULT_DEVICE
from sprintlab.core.reading import read_json

if TYPE_CHECKING:
    from sprintlab.control import Policy
    from sprintlab.robots import RobotDescription
    from sprintlab.viewer.live import Session
    from sprintlab.viewer.replay import ReplayRun, ReplayText

RUNS = Path("runs")
RECORDING = "trajectory.npz"
_FIELDS: dict[str, Any] = {
    "robot": str,
    "policy": str,
    "distance_m": (int, float),
    "sprint_time_s": (int, float),
    "time_100m_s": (int, float),
    "top_speed_command_m_s": (int, float),
    "audit": dict,
}
"""What the page takes from the numbers of a race; each may be missing or null."""


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class ReplayPage(Result):
    """Recorded runs as one HTML file; a notebook shows the page itself.

    Attributes:
        path: the file.
    """

    path: Path

    def _repr_mimebundle_(self, **_: Any) -> dict[str, str]:
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
    paths = [_trajectory_path(None if run is None else Path(run)) for run in run_folders or (None,)]
    if names and len(names) != len(paths):
        raise InvalidValueError("names", " ".join(names), f"one name for each of {len(paths)} runs")
    results = [_race_result(path.with_name("result.json")) for path in paths]
    runs = [_run(path, result, robot) for path, result in zip(paths, results, strict=True)]
    if is_lap(runs[0].arrays):
        results[0].setdefault("distance_m", 400.0)
    pace = _record_pace(_sprint_of(results[0])[1]) if world_record else None
    if names:
        runs = [replace(run, name=name) for run, name in zip(runs, names, strict=True)]
    text = _text(paths[0], runs[0].robot.name, results[0], runs[0].name)
    alone = len(runs) == 1 and pace is None
    if not alone:
        against = " against ".join([*(run.name for run in runs), *(["the world record"] if pace else [])])
        text = replace(text, title=against, subtitle=f"{text.distance:g} m")
    page = paths[0].with_name("replay.html" if alone else "ghosts.html") if output is None else Path(output)
    write_replay(page, runs[0].arrays, runs[0].robot, text, runs[1:], pace)
    numbers = {"page": str(page), "bytes": page.stat().st_size}
    return ReplayPage(numbers=numbers, shown=[f"replay: {page}"], path=page)


def write_race_replay(folder: Path, robot: RobotDescription) -> None:
    """The 100 m of this robot as an interactive page beside the report."""
    from sprintlab.viewer.replay import load_arrays, write_replay

    text = _text(folder / RECORDING, robot.name, _race_result(folder / "result.json"))
    write_replay(folder / "replay.html", load_arrays(folder / RECORDING), robot, text)


def _run(path: Path, result: dict[str, Any], robot: RobotChoice) -> ReplayRun:
    from sprintlab.robots import load_robot
    from sprintlab.viewer.replay import ReplayRun, load_arrays

    if robot is None and (named := result.get("robot")):
        robot = known_robot(named, "result.json")
    described = load_robot(robot or default_robot())
    name = str(result.get("policy", path.absolute().parent.name if path.name == RECORDING else path.stem))
    return ReplayRun(arrays=load_arrays(path), robot=described, name=name)


def _record_pace(distance: float) -> Any:
    from sprintlab.viewer.replay import WORLD_RECORDS

    if distance not in WORLD_RECORDS:
        known = " and ".join(f"{known:g} m" for known in WORLD_RECORDS)
        raise InvalidValueError("world_record", f"{distance:g} m", f"records are known over {known}")
    return WORLD_RECORDS[distance]


def _trajectory_path(run: Path | None) -> Path:
    if run is None:
        races = sorted(RUNS.glob(f"race-*/{RECORDING}"), key=lambda path: path.stat().st_mtime)
        if not races:
            raise SprintlabError(f"there is no race in {RUNS}/ yet; run one with: sprintlab race")
        return races[-1]
    if not run.exists():
        raise SprintlabError(f"{run} does not exist; name the folder of a race or a trajectory (.npz)")
    return run / RECORDING if run.is_dir() else run


def _race_result(path: Path) -> dict[str, Any]:
    """The numbers beside a trajectory; empty without them."""
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


def _sprint_of(result: dict[str, Any]) -> tuple[float | None, float]:
    """Time [s], ``None`` where the distance was not reached, and distance [m] of a race's numbers."""
    return result.get("sprint_time_s", result.get("time_100m_s")), float(result.get("distance_m", 100.0))


def _text(trajectory: Path, robot: str, result: dict[str, Any], runner: str = "") -> ReplayText:
    """Heading and subtitle of the page."""
    from sprintlab.viewer.replay import ReplayText

    time, distance = _sprint_of(result)
    sprint = trajectory.name == RECORDING and time is not None
    what = f"{distance:g} m in {time:.2f} s" if sprint else trajectory.stem
    policy, top = result.get("policy"), result.get("top_speed_command_m_s")
    verdicts = {None: "", True: "exploit audit passed", False: "exploit audit FAILED"}
    parts = [f"policy {policy}" if policy else "", f"command up to {top:g} m/s" if top else ""]
    parts.append(verdicts[result.get("audit", {}).get("passed")])
    return ReplayText(
        title=f"{robot.upper()}: {what}",
        subtitle=", ".join(filter(None, parts)),
        distance=distance,
        runner=runner,
    )


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Playing(Result):
    """A page on which a robot is driven.

    Attributes:
        address: to open in a browser.
        serve: simulates until Ctrl-C or the end of the time.
    """

    address: str
    serve: Callable[[], None]

    def run(self) -> None:
        """Simulate until Ctrl-C or the end of the time."""
        with suppress(KeyboardInterrupt):
            self.serve()


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
    open: bool = False,
) -> Playing:
    """Drive a robot in the browser: speed, turns, pushes, slope, friction, payload, policy, motor model.

    Args:
        policies: policy files, or names of policies that come with the package; those that fit the robot
            when left out. The page switches between them.
        robot: a robot's name, or a parameter table of one's own (.toml); the first policy's when left out,
            without a policy, that of sprint.
        host: interface to listen on; 0.0.0.0 lets other machines in.
        port: first port to try.
        gamepad: drive with a gamepad too.
        gamepad_device: which one.
        duration: stop after this time [s]; runs until Ctrl-C when left out.
        open: also open the page in a browser.

    Raises:
        SprintlabError: viser is missing, policy or gamepad are refused, or nothing can be served there.
    """
    require_package("viser", extra="play", use="sprintlab play")
    from sprintlab.viewer.page import Page, PageOptions

    options = PageOptions(
        host=host, port=port, duration=duration, gamepad=gamepad_device if gamepad else None
    )
    page = Page(live_session(policies, robot), options)
    shown = [f"open {page.address} in a browser; Ctrl-C ends it"]
    if open:
        import webbrowser

        shown += [] if webbrowser.open(page.address) else ["no browser could be opened here"]
    return Playing(numbers={"address": page.address}, shown=shown, address=page.address, serve=page.run)


def live_session(names: Sequence[str], robot: RobotChoice) -> Session:
    """The running robot behind such a page, with the policies that it can switch between.

    Raises:
        SprintlabError: a policy or the robot is refused, or none fits.
    """
    from sprintlab.control import check_contract, shipped_policies
    from sprintlab.robots import load_robot
    from sprintlab.viewer.live import Session

    chosen = names or sorted(shipped_policies(), key=lambda name: (name != "sprint", name))
    opened = dict(_labelled(map(policy_path, chosen)))
    if robot is None:
        robot = robot_of(next(iter(opened.values())), policy_path(chosen[0]).name)
    described = load_robot(robot)
    if names:
        return Session(described, opened)
    fitting: dict[str, Policy] = {}
    for label, policy in opened.items():
        with suppress(ContractMismatchError):
            check_contract(policy.contract, described)
            fitting[label] = policy
    if not fitting:
        raise SprintlabError(
            f"no policy for robot {described.name} comes with the package; name a policy file"
        )
    return Session(described, fitting)


def _labelled(paths: Iterator[Path]) -> Iterator[tuple[str, Policy]]:
    """Policies by their names; a number is added to a name that comes twice."""
    labels = set[str]()
    for path in paths:
        label = path.stem if path.stem not in labels else f"{path.stem} ({len(labels) + 1})"
        labels.add(label)
        yield label, load_policy(path)
