"""``turning`` and ``lap``: how well a policy follows a path that is not straight."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import RenderableType

from sprintlab.api.drive import DriveOptions
from sprintlab.api.policies import OfAPolicy, PolicyChoice, RobotChoice, policy_path, robot_for, trial_pool
from sprintlab.api.processes import Progress, leave_to_the_parent
from sprintlab.api.tables import Drawn, in_notebook, plain_table, written_for
from sprintlab.core.arguments import checked
from sprintlab.core.checks import check_choice
from sprintlab.core.files import check_writable_file

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from sprintlab.evaluation.lap import LapResult
    from sprintlab.evaluation.turning import TurningMap

TURNING_SPEEDS = (0.0, 2.0, 4.0, 6.0, 8.0, 10.0, 12.0)


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Turning(OfAPolicy, Drawn):
    """Achieved over commanded yaw rate of one policy, over speeds and yaw rates.

    Attributes:
        found: every turn.
    """

    found: TurningMap

    def tables(self) -> Iterator[RenderableType]:
        """Gain by speed and share of the largest yaw rate, and the worst of the moderate turns."""
        from sprintlab.evaluation.turning import turning_rows

        shares = tuple(f"{100 * share:+.0f} %" for share in self.found.settings.fractions)
        columns = ("speed [m/s]", "largest [rad/s]", *shares)
        title = f"Turning of {self.policy}: achieved over commanded yaw rate"
        yield plain_table(title, *columns, numbers=columns, rows=turning_rows(self.found))
        yield "Columns: shares of the largest yaw rate that friction allows (at most 1 rad/s), left positive."
        least = self.found.least_gain
        worst = f"{100 * least:.0f} %" if least == least else "undefined, since one fell"
        yield f"Worst turn with |v w| up to half of mu g: {worst}. Falls: {self.found.falls}."
        yield from self.notes

    def plot(self) -> Figure:
        """Commanded and achieved turns over speed and yaw rate."""
        from sprintlab.evaluation.sweep_figures import turning_figure

        return in_notebook(turning_figure(self.found))


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Lap(OfAPolicy, Drawn):
    """One lap of a 400 m track in lane 1.

    Attributes:
        found: the lap.
        recording: where the recorded run was written, if anywhere.
    """

    found: LapResult
    recording: Path | None = None

    def tables(self) -> Iterator[RenderableType]:
        """Time, lane, energy, heat."""
        lap = self.found
        title = f"{lap.distance:.0f} m in lane 1 with {self.policy}, {lap.trial.top_speed:g} m/s commanded"
        table = plain_table(title, "quantity", "value")
        fell = f"fell ({lap.trial.fall_reason})" if lap.trial.fall_reason else "not run to its end"
        time = f"{lap.time:.2f} s" if lap.finished else fell
        table.add_row("time", time if lap.lane_kept else f"{time} (left the lane)")
        table.add_row("farthest outside the measured line (lane: 0.92 m)", f"{lap.outward:.2f} m")
        table.add_row("farthest inside it (kerb: 0.30 m)", f"{lap.inward:.2f} m")
        table.add_row("energy from the bus", f"{lap.energy / 1000.0:.1f} kJ")
        if lap.hottest_winding is not None:
            table.add_row("hottest winding", f"{lap.hottest_winding:.0f} degC")
        yield table
        if self.recording is not None:
            yield f"recording: {self.recording}; look at it with: sprintlab replay {self.recording}"
        yield from self.notes

    def plot(self) -> Figure:
        """The path that was run, on the lane."""
        from sprintlab.evaluation.sweep_figures import lap_figure

        return in_notebook(lap_figure(self.found))


@checked
def turning(
    policy: PolicyChoice = "sprint",
    *,
    robot: RobotChoice = None,
    speeds: Sequence[float] = TURNING_SPEEDS,
    drive: DriveOptions | None = None,
    workers: int | None = None,
    progress: Progress = lambda what, share: None,
) -> Turning:
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
    leave_to_the_parent()
    from sprintlab.evaluation.turning import TurningSettings, turning_map

    plant = (drive or DriveOptions()).plant()
    settings, path = TurningSettings(speeds=tuple(speeds), plant=plant), policy_path(policy)
    with trial_pool(path, robot, workers) as pool:
        found = turning_map(
            pool, settings, lambda speed, done, total: progress(f"turning at {speed}", done / total)
        )
    return Turning(policy=path.stem, found=found, notes=plant.remarks)


@checked
def lap(
    policy: PolicyChoice = "sprint",
    top_speed: float = 10.0,
    *,
    robot: RobotChoice = None,
    self_paced: bool = False,
    recording: Path | None = None,
    drive: DriveOptions | None = None,
    progress: Progress = lambda what, share: None,
) -> Lap:
    """Run one lap of a standard 400 m track in lane 1: time, lane, energy, heat.

    Args:
        policy: a policy file, or the name of a policy that comes with the package.
        top_speed: commanded speed [m/s].
        robot: a robot's name, or a parameter table of one's own (.toml); the policy's when left out.
        self_paced: hold the command near the measured speed, as ``self_paced`` does.
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
    from sprintlab.evaluation.race_files import save_trajectory
    from sprintlab.evaluation.trial import TrialRequest
    from sprintlab.robots import load_robot

    path, plant = policy_path(policy), (drive or DriveOptions()).plant()
    request = TrialRequest(top_speed=top_speed, self_paced=self_paced, plant=plant, keep_trajectory=True)
    loaded, described = load_policy(path), load_robot(robot_for(path, robot))
    check_contract(loaded.contract, described)
    progress("running a lap", None)
    found = run_lap(loaded, described, request)
    run = Lap(policy=path.stem, found=found, notes=plant.remarks)
    if recording is not None and found.trial.trajectory is not None:
        with written_for(run):
            save_trajectory(Path(recording), found.trial.trajectory)
    return replace(run, recording=recording)
