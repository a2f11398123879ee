"""``turning``, ``lap``, ``ground`` and ``robustness``: beyond the straight and level sprint."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import RenderableType

from sprintlab.api.drive import DriveOptions
from sprintlab.api.policies import PolicyChoice, RobotChoice, policy_and_robot, policy_path, trial_pool
from sprintlab.api.results import Drawn, Progress, Result, kept, silent, table
from sprintlab.core.arguments import checked
from sprintlab.core.checks import check_choice
from sprintlab.core.files import check_writable_file

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from sprintlab.evaluation.ground import GroundResult
    from sprintlab.evaluation.lap import LapResult
    from sprintlab.evaluation.turning import TurningMap


@checked
def turning(
    policy: PolicyChoice,
    *,
    robot: RobotChoice = None,
    speeds: Sequence[float] = (0.0, 2.0, 4.0, 6.0, 8.0, 10.0, 12.0),
    drive: DriveOptions = DriveOptions(),
    workers: int | None = None,
    progress: Progress = silent,
) -> Drawn:
    """Measure how much of a commanded yaw rate a policy turns with, at every speed.

    Yaw rates go up to what friction allows, |v w| = mu g, and at most 1 rad/s.

    Args:
        policy: a policy file, or the name of a policy that comes with the package.
        robot: a robot's name, or a parameter table of one's own (.toml); the policy's when left out.
        speeds: commanded forward speeds [m/s].
        drive: motor model, battery and heat; the published numbers' when left out.
        workers: processes; one a core when left out.
        progress: called with what is being done and the share done.

    Raises:
        SprintlabError: the policy, the robot or a setting is refused, or the simulation failed.
    """
    from sprintlab.evaluation.turning import TurningSettings, turning_map

    def draw() -> Figure:
        from sprintlab.evaluation.sweep_figures import turning_figure

        return turning_figure(found)

    plant, name = drive.plant(), policy_path(policy).stem
    settings = TurningSettings(speeds=tuple(speeds), plant=plant)
    with trial_pool(policy, robot, workers) as pool:
        found = turning_map(
            pool, settings, lambda speed, done, total: progress(f"turning at {speed}", done / total)
        )
    numbers = {"policy": name, **found.to_dict(), "notes": plant.remarks}
    shown = [*_turning_shown(name, found), *plant.remarks]
    return Drawn(numbers=numbers, shown=shown, found=found, draw=draw)


def _turning_shown(policy: str, found: TurningMap) -> Iterator[RenderableType]:
    """Gain by speed and share of the largest yaw rate, and the worst of the moderate turns."""
    from sprintlab.evaluation.turning import turning_rows

    shares = (f"{100 * share:+.0f} %" for share in found.settings.fractions)
    columns = ("speed [m/s]", "largest [rad/s]", *shares)
    title = f"Turning of {policy}: achieved over commanded yaw rate"
    yield table(title, *columns, numbers=columns, rows=turning_rows(found))
    yield "Columns: shares of the largest yaw rate that friction allows (at most 1 rad/s), left positive."
    least = found.least_gain
    worst = f"{100 * least:.0f} %" if least == least else "undefined, since one fell"
    yield f"Worst turn with |v w| up to half of mu g: {worst}. Falls: {found.falls}."


@checked
def lap(
    policy: PolicyChoice,
    *,
    top_speed: float = 10.0,
    robot: RobotChoice = None,
    self_paced: bool = False,
    recording: Path | None = None,
    drive: DriveOptions = DriveOptions(),
    progress: Progress = silent,
) -> Drawn:
    """Run one lap of a standard 400 m track in lane 1: time, lane, energy, heat.

    Args:
        policy: a policy file, or the name of a policy that comes with the package.
        top_speed: commanded speed [m/s].
        robot: a robot's name, or a parameter table of one's own (.toml); the policy's when left out.
        self_paced: hold the command near the measured speed.
        recording: also write the run here (.npz), for ``sprintlab replay``.
        drive: motor model, battery and heat; the published numbers' when left out.
        progress: called with what is being done.

    Raises:
        SprintlabError: the policy, the robot or a setting is refused, or the simulation failed.
        UnwrittenError: the disk has no room for the recording any more; its ``found`` is the lap.
    """
    if recording is not None:
        check_choice("recording's ending", Path(recording).suffix, (".npz",))
        check_writable_file(recording)
    from sprintlab.control import check_contract, load_policy
    from sprintlab.evaluation.lap import run_lap
    from sprintlab.evaluation.trial import TrialRequest
    from sprintlab.robots import load_robot

    def draw() -> Figure:
        from sprintlab.evaluation.sweep_figures import lap_figure

        return lap_figure(found)

    path, named = policy_and_robot(policy, robot)
    plant = drive.plant()
    request = TrialRequest(top_speed=top_speed, self_paced=self_paced, plant=plant, keep_trajectory=True)
    loaded, described = load_policy(path), load_robot(named)
    check_contract(loaded.contract, described)
    progress("running a lap", None)
    found = run_lap(loaded, described, request)
    result = Drawn(
        numbers={"policy": path.stem, **found.to_dict(), "notes": plant.remarks},
        shown=[_lap_table(path.stem, found), *plant.remarks],
        found=found,
        draw=draw,
        status=1 if found.trial.fall_reason else 0,
    )
    if recording is None or found.trial.trajectory is None:
        return result
    from sprintlab.evaluation.race_files import save_trajectory

    with kept(result):
        save_trajectory(Path(recording), found.trial.trajectory)
    where = f"recording: {recording}; look at it with: sprintlab replay {recording}"
    return replace(result, shown=[*result.shown, where])


def _lap_table(policy: str, lap: LapResult) -> RenderableType:
    title = f"{lap.distance:.0f} m in lane 1 with {policy}, {lap.trial.top_speed:g} m/s commanded"
    fell = f"fell ({lap.trial.fall_reason})" if lap.trial.fall_reason else "not run to its end"
    time = f"{lap.time:.2f} s" if lap.finished else fell
    rows = [
        ("time", time if lap.lane_kept else f"{time} (left the lane)"),
        ("farthest outside the measured line (lane: 0.92 m)", f"{lap.outward:.2f} m"),
        ("farthest inside it (kerb: 0.30 m)", f"{lap.inward:.2f} m"),
        ("energy from the bus", f"{lap.energy / 1000.0:.1f} kJ"),
    ]
    if lap.hottest_winding is not None:
        rows.append(("hottest winding", f"{lap.hottest_winding:.0f} degC"))
    return table(title, "quantity", "value", rows=rows)


@checked
def ground(
    policy: PolicyChoice,
    *,
    top_speed: float = 10.0,
    trials: int = 3,
    slope: float = 0.05,
    roughness: float = 0.02,
    robot: RobotChoice = None,
    drive: DriveOptions = DriveOptions(),
    workers: int | None = None,
    progress: Progress = silent,
) -> Result:
    """Measure what slopes and rough ground cost a policy: falls, and speed held against level ground.

    Args:
        policy: a policy file, or the name of a policy that comes with the package.
        top_speed: commanded speed of the evaluation's profile [m/s].
        trials: seeded trials on each ground; on rough ground each has heights of its own.
        slope: rise over run, run up and down: 0.05 is 5 %.
        roughness: greatest height of the rough ground above and below its mean [m].
        robot: a robot's name, or a parameter table of one's own (.toml); the policy's when left out.
        drive: motor model, battery and heat; the published numbers' when left out.
        workers: processes; one a core when left out.
        progress: called with what is being done and the share done.

    Raises:
        SprintlabError: the policy, the robot or a setting is refused, or the simulation failed.
    """
    from sprintlab.evaluation.ground import GroundSettings, compare_grounds

    plant, name = drive.plant(), policy_path(policy).stem
    settings = GroundSettings(
        top_speed=top_speed, trials=trials, slope=slope, roughness=roughness, plant=plant
    )
    with trial_pool(policy, robot, workers) as pool:
        found = compare_grounds(
            pool, settings, lambda kind, done, total: progress(f"on {kind} ground", done / total)
        )
    numbers = {"policy": name, **found.to_dict(), "notes": plant.remarks}
    note = "Held: along the ground, mean of the upright trials. Met: all upright, too."
    return Result(numbers=numbers, shown=[_ground_table(name, found), note, *plant.remarks], found=found)


def _ground_table(policy: str, found: GroundResult) -> RenderableType:
    from sprintlab.evaluation.ground import LARGEST_LOSS
    from sprintlab.evaluation.quantities import number

    settings = found.settings
    names = {"level": "level", "rough": f"rough, ±{100 * settings.roughness:g} cm"}
    columns = ("ground", "upright", "held [m/s]", "change", f"at most -{100 * LARGEST_LOSS:.0f} %")
    title = f"{policy} on slopes and rough ground, {settings.top_speed:g} m/s commanded"
    made = table(title, *columns, numbers=columns[1:4])
    for trials in found.grounds:
        change, level = found.change(trials), trials is found.grounds[0]
        reasons = f" ({', '.join(sorted(set(trials.falls)))})" if trials.falls else ""
        made.add_row(
            names.get(trials.name, f"{100 * settings.slope:g} % {trials.name}"),
            f"{trials.upright} of {trials.trials}{reasons}",
            number(trials.held_speed),
            "" if level else f"{100 * change:+.0f} %" if change == change else "-",
            "" if level else "met" if found.met(trials) else "not met",
        )
    return made


@checked
def robustness(
    policy: PolicyChoice = "sprint",
    *,
    robot: RobotChoice = None,
    trials: int = 1000,
    cause_trials: int = 20,
    top_speed: float | None = None,
    distance: float = 100.0,
    seed: int = 0,
    workers: int | None = None,
    output: Path | str | None = None,
    progress: Progress = silent,
) -> Drawn:
    """Run many sprints with everything randomized at once: how many stay upright, what they hold.

    Friction, payload, centre of mass, strength, bus voltage, delay, sensor noise, joint offsets, pushes and
    foot pads are drawn anew for every sprint; a few more sprints randomize one of them at a time and tell
    what each costs. Every sprint is kept in a file of its own: run the same again after a kill, or with more
    trials, and it goes on where it was.

    Args:
        policy: a policy file, or the name of a policy that comes with the package.
        robot: a robot's name, or a parameter table of one's own (.toml); the policy's when left out.
        trials: sprints with everything randomized at once.
        cause_trials: sprints of each cause alone, and of the nominal robot.
        top_speed: speed asked for [m/s]; when left out, that of the folder, or a search finds that at which
            most is held.
        distance: of a sprint [m].
        seed: of the first sprint; the next one has the next seed.
        workers: processes; one a core when left out.
        output: folder of the sprints; runs/robustness-<policy> when left out.
        progress: called with what is being done and the share done.

    Raises:
        SprintlabError: policy, robot, folder or a setting is refused, or the simulation failed.
    """
    from sprintlab.evaluation.race import find_top_speed
    from sprintlab.evaluation.robustness import StudySettings, run_study, summarize
    from sprintlab.evaluation.sweep import stored_study

    def draw() -> Figure:
        from sprintlab.evaluation.sweep_figures import robustness_figure

        return robustness_figure(found, sprints, title)

    name = policy_path(policy).stem
    folder = Path("runs") / f"robustness-{name}" if output is None else Path(output)
    stored = stored_study(folder)
    settings = StudySettings(  # refused before the search for a speed
        top_speed=1.0 if top_speed is None else top_speed, trials=trials, cause_trials=cause_trials,
        distance=distance, seed=seed,
    )  # fmt: skip
    with trial_pool(policy, robot, workers) as pool:
        speed = top_speed or stored.get("top_speed")
        if not speed:
            progress("searching the top speed", None)
            speed = find_top_speed(pool)
        settings = replace(settings, top_speed=speed)
        sprints = run_study(
            pool, settings, folder, lambda done, total: progress(f"sprint {done} of {total}", done / total)
        )
    asked = {"top_speed_command_m_s": speed, "distance_m": distance, "seed": seed}
    found, title = summarize(sprints), f"{name}, {distance:g} m at a command of {speed:g} m/s"
    return Drawn(
        numbers={"policy": name, **asked, **found, "folder": str(folder)},
        shown=[*_robustness_shown(f"{title}, everything randomized at once", found), f"\nsprints: {folder}"],
        found=sprints,
        draw=draw,
    )


def _robustness_shown(title: str, found: dict[str, Any]) -> Iterator[RenderableType]:
    """All sprints together, then one cause at a time."""

    def cell(value: float | None, sign: str = "") -> str:
        return "-" if value is None else f"{value:{sign}.2f}"

    made, trials = table(title, "quantity", "value", "unit"), found["trials"]
    lower, upper = (f"{100 * bound:.1f}" for bound in found["interval_95"])
    made.add_row("upright", f"{found['upright']} of {trials}", "")
    share = f"{100 * found['share_upright']:.1f} ({lower} to {upper})"
    made.add_row("share upright, 95 % interval", share, "%")
    made.add_row("reached the line", f"{found['finished']} of {trials}", "")
    made.add_row("left its lane", f"{found['left_lane']} of {trials}", "")
    for reason, count in found["falls"].items():
        made.add_row(f"falls: {reason}", str(count), "")
    for quantile, speed in found["held_speed_quantiles_m_s"].items():
        made.add_row(f"held speed, {100 * float(quantile):g} % hold less", cell(speed), "m/s")
    made.add_row("held speed of the nominal robot", cell(found["nominal"]["held_speed_m_s"]), "m/s")
    yield made
    if found["causes"]:
        yield ""
        columns = ("upright", "change of held speed [m/s]", "worst sprint [m/s]")
        rows = (
            (
                row["cause"],
                f"{row['upright']} of {row['trials']}",
                cell(row["change_m_s"], "+"),
                cell(row["worst_change_m_s"], "+"),
            )
            for row in found["causes"]
        )
        title = "One cause at a time, the most expensive first"
        yield table(title, "cause", *columns, numbers=columns, rows=rows)
