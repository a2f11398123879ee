"""``turning``, ``lap``, ``ground`` and ``robustness``: beyond the straight and level sprint."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from sprintlab.api.drive import DriveOptions
from sprintlab.api.policies import PolicyChoice, RobotChoice, open_policy, policy_path, trial_pool
from sprintlab.api.results import Drawn, Progress, Result, drawn, kept, quantities, records, silent, table
from sprintlab.core.arguments import checked
from sprintlab.core.checks import check_choice
from sprintlab.core.files import check_writable_file
from sprintlab.evaluation.ground import ground_cases, ground_numbers
from sprintlab.evaluation.lap import run_lap
from sprintlab.evaluation.race import find_top_speed
from sprintlab.evaluation.robustness import StudySettings, run_study, summarize
from sprintlab.evaluation.sweep import run_cases, stored_study
from sprintlab.evaluation.trial import TrialRequest
from sprintlab.evaluation.turning import FRACTIONS, turning_map, turning_rows


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
    """Measure how much of each commanded yaw rate a policy achieves, at every speed.

    Yaw rates go up to what friction allows, |v w| = mu g, and at most 1 rad/s.
    Example: sprintlab turning sprint --figure turning.png

    Args:
        speeds: commanded forward speeds [m/s].
    """
    plant, name = drive.plant(), policy_path(policy).stem
    with trial_pool(policy, robot, workers) as pool:
        found = turning_map(pool, speeds, plant, _counted(progress, "turning at {}"))
    columns = ("speed [m/s]", "largest [rad/s]", *(f"{100 * share:+.0f} %" for share in FRACTIONS))
    title = f"Turning of {name}: achieved over commanded yaw rate"
    least = found["least_gain_up_to_half_of_friction"]
    worst = "undefined, since one fell" if least is None else f"{100 * least:.0f} %"
    shown = [
        table(title, *columns, numbers=columns, rows=turning_rows(found)),
        "Columns: shares of the largest yaw rate that friction allows (at most 1 rad/s), left positive.",
        f"Worst turn with |v w| up to half of mu g: {worst}. Falls: {found['falls']}.",
        *plant.remarks,
    ]
    numbers = {"policy": name, **found, "notes": plant.remarks}
    draw = drawn("evaluation.sweep_figures.turning_figure", found)
    return Drawn(numbers=numbers, shown=shown, found=found, draw=draw)


def _counted(progress: Progress, what: str) -> Callable[[object, int, int], None]:
    """Progress told with what is run, how many are done and of how many."""
    return lambda each, done, total: progress(what.format(each), done / total)


@checked
def lap(
    policy: PolicyChoice,
    *,
    top_speed: float = 9.0,
    robot: RobotChoice = None,
    recording: Path | None = None,
    drive: DriveOptions = DriveOptions(),
    progress: Progress = silent,
) -> Drawn:
    """Run one lap of a standard 400 m track in lane 1: time, lane, energy, heat.

    The lane reaches 0.92 m outward and 0.30 m inward of the measured line.
    Example: sprintlab lap sprint --top-speed 8 --battery --heat

    Args:
        recording: also write the run here (.npz), for sprintlab replay.
    """
    if recording is not None:
        check_choice("recording's ending", Path(recording).suffix, (".npz",))
        check_writable_file(recording)
    plant = drive.plant()
    request = TrialRequest(top_speed=top_speed, plant=plant, keep_trajectory=True)
    path, loaded, described = open_policy(policy, robot)
    progress("running a lap", None)
    trial, found = run_lap(loaded, described, request)
    numbers = {"policy": path.stem, **found, "notes": plant.remarks}
    result = Drawn(
        numbers=numbers,
        shown=[
            quantities(f"{found['distance_m']:.0f} m in lane 1 with {path.stem}", numbers),
            *plant.remarks,
        ],
        found=found,
        draw=drawn("evaluation.sweep_figures.lap_figure", trial),
        status=1 if trial.fall_reason else 0,
    )
    if recording is None or trial.trajectory is None:
        return result
    from sprintlab.evaluation.race_files import save_trajectory

    with kept(result):
        save_trajectory(Path(recording), trial.trajectory, described.joint_names)
    where = f"recording: {recording}; look at it with: sprintlab replay {recording}"
    return replace(result, shown=[*result.shown, where])


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

    A ground is met where all trials stay upright and lose no more speed than the largest loss allowed.
    Example: sprintlab ground sprint --top-speed 10

    Args:
        trials: trials on each ground; on rough ground each has heights of its own.
        slope: rise over run, run up and down: 0.05 is 5 %.
        roughness: greatest height of the rough ground above and below its mean [m].
    """
    plant, name = drive.plant(), policy_path(policy).stem
    cases = ground_cases(top_speed, trials, slope, roughness, plant)
    with trial_pool(policy, robot, workers) as pool:
        runs = run_cases(pool, cases, _counted(progress, "on {} ground"))
    asked = {"top_speed_command_m_s": top_speed, "slope": slope, "roughness_m": roughness}
    numbers = {"policy": name, **asked, **(found := ground_numbers(runs)), "notes": plant.remarks}
    shown = [quantities("Slopes and rough ground", numbers), records("", numbers["grounds"]), *plant.remarks]
    return Result(numbers=numbers, shown=shown, found=found)


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
    """Run many sprints with everything randomized at once: how many stay upright, how fast they run.

    A few more randomize one cause at a time. Each sprint is kept in a file: the same command, started again,
    continues from there.
    Example: sprintlab robustness sprint --trials 100 --figure spread.png

    Args:
        trials: sprints with everything randomized at once.
        cause_trials: sprints of each cause alone, and of the nominal robot.
        top_speed: commanded speed [m/s]; when left out, that of the folder's sprints, or what a search finds.
        seed: seed of the first sprint; the next one has the next seed.
        output: folder of the sprints; runs/robustness-<policy> when left out.
    """
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
        sprints = run_study(pool, settings, folder, lambda n, of: progress(f"sprint {n} of {of}", n / of))
    asked = {"top_speed_command_m_s": speed, "distance_m": distance, "seed": seed}
    numbers = {"policy": name, **asked, **summarize(sprints), "folder": str(folder)}
    title = f"{name}, {distance:g} m at a command of {speed:g} m/s"
    causes = records("\nOne cause at a time, the most expensive first", numbers["causes"])
    draw = drawn("evaluation.sweep_figures.robustness_figure", numbers, sprints, title)
    shown = [quantities(f"{title}, everything randomized at once", numbers), causes]
    return Drawn(numbers=numbers, shown=shown, found=sprints, draw=draw)
