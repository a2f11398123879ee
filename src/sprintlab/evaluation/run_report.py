"""A run on a robot beside its simulation: figures, numbers, one self-contained HTML page.

The robot's side knows less than a simulator: its speed comes ten times a second from a receiver, and nothing
tells what its feet do. What it does not know is not drawn.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from sprintlab.commands import command_start, finish_time
from sprintlab.control import Policy
from sprintlab.core.array_types import FloatArray
from sprintlab.core.json_values import json_ready
from sprintlab.core.smoothing import moving_average
from sprintlab.core.text import number
from sprintlab.core.theme import LIGHT, legend_above, themed_figure
from sprintlab.evaluation import figures
from sprintlab.evaluation.metrics import trial_metrics
from sprintlab.evaluation.report import (
    Picture,
    PlannedFigure,
    draw_pictures,
    embedded,
    page_template,
    trial_figures,
)
from sprintlab.evaluation.results import QUANTITIES, Trajectory, TrialResult, quantity_numbers
from sprintlab.evaluation.trial import Course, TrialRequest, run_course
from sprintlab.plant import BaseState
from sprintlab.robots import RobotDescription


@dataclass(frozen=True, kw_only=True)
class TrackRun:
    """A run as a receiver on the robot saw it."""

    trial: TrialResult  # its speed is straight between the fixes
    fix_time: FloatArray  # (F,) [s]
    fix_speed: FloatArray  # (F,) along the course [m/s]
    fix_distance: FloatArray  # (F,) along the course [m]
    command_time: FloatArray  # (P,) of the policy steps [s]
    command: FloatArray  # (P, 3) given to the policy
    distance: float  # to be timed [m]
    faults: dict[str, int]  # how often each was noticed

    @property
    def time_over_distance(self) -> float:
        """From the first non-zero command to the distance, between the fixes straight [s]; nan if not run."""
        finish = finish_time(self.fix_time, self.fix_distance, self.distance)
        return finish - command_start(self.command_time, self.command[:, 0])


class _LoggedCourse(Course):
    """Asks for the speeds that a log holds."""

    def __init__(self, time: FloatArray, forward: FloatArray) -> None:
        self.time, self.forward, self.longest = time, forward, float(time[-1]) + 0.02

    def speed(self, time: float, base: BaseState) -> float | None:
        index = int(np.searchsorted(self.time, time + 1e-6, side="right")) - 1
        return float(self.forward[max(index, 0)]) if time < self.longest - 1e-9 else None


def simulate_commands(
    policy: Policy,
    robot: RobotDescription,
    time: FloatArray,
    forward: FloatArray,
    hold: tuple[float, float],
) -> TrialResult:
    """Give the commanded speeds of a log to the same policy in simulation.

    The heading loop is closed anew: a yaw rate from the log would not keep another run on its course.

    Args:
        policy: that drove the robot.
        robot: its description.
        time: ``(P,)`` of the commands, rising from zero [s].
        forward: ``(P,)`` commanded forward speed [m/s].
        hold: start and end of what counts as the hold [s].

    Raises:
        SprintlabError: as ``run_trial``.
    """
    request = TrialRequest(top_speed=max(float(forward.max()), 0.1), keep_trajectory=True)
    trial = run_course(policy, robot, request, _LoggedCourse(time=time, forward=forward))
    metrics = trial_metrics(figures.recorded(trial), robot, hold, plant=request.plant)
    return replace(trial, metrics=metrics, hold_interval=hold)


def comparison_figure(run: TrackRun, simulation: TrialResult | None) -> Figure:
    """Command, measured speed and simulated speed over time; distance over time below."""
    figure, (speed, distance) = themed_figure(LIGHT, (9.5, 6.4), 2, 1, sharex=True)
    draw = figures.draw_curve
    draw(speed, run.command_time, run.command[:, 0], LIGHT.command, linewidth=1.2, label="command")
    if simulation is not None:
        motion = figures.recorded(simulation)
        label = "simulation, 0.1 s mean"
        draw(speed, motion.time, _receiver_speed(motion), LIGHT.second, linewidth=1.4, label=label)
        draw(distance, motion.time, motion.qpos[:, 0] - motion.qpos[0, 0], LIGHT.second, linewidth=1.4)
    look: dict[str, Any] = {"marker": "o", "markersize": 3.0, "linewidth": 0.9}
    draw(speed, run.fix_time, run.fix_speed, LIGHT.speed, label="robot, position receiver", **look)
    draw(distance, run.fix_time, run.fix_distance, LIGHT.speed, **look)
    distance.axhline(run.distance, color=LIGHT.muted, linewidth=0.8, linestyle=":")
    speed.set(ylabel="forward speed [m/s]", xlim=(0.0, float(run.command_time[-1])))
    distance.set(ylabel="distance [m]", xlabel="time since the policy took over [s]")
    legend_above(speed, LIGHT)
    return figure


def _receiver_speed(motion: Trajectory) -> FloatArray:
    """Forward speed ``(T,)`` of a simulation as a receiver sees it, a mean of 0.1 s [m/s]."""
    return moving_average(motion.velocity[:, 0], motion.time, 0.1)


def make_run_pictures(
    run: TrackRun,
    simulation: TrialResult | None,
    robot: RobotDescription,
    progress: Callable[[str], None] = lambda _: None,
) -> tuple[Picture, ...]:
    """Draw the run beside its simulation.

    The gait is the simulation's, since a robot does not measure its own.

    Raises:
        SimulationError: a trajectory is missing or holds NaN.
    """
    comparison = (
        "comparison",
        "Robot and simulation" if simulation else "The run",
        "Dots: what the robot's receiver says. The simulation is given the speeds that the robot's policy "
        "was given, so a gap between the two is the gap between robot and model.",
        lambda: comparison_figure(run, simulation),
    )
    own = [figure for figure in trial_figures(run.trial, robot) if figure[0] != "gait"]
    gait: list[PlannedFigure] = [
        (name, f"{title} in simulation", caption, draw)
        for name, title, caption, draw in (trial_figures(simulation, robot) if simulation else ())
        if name == "gait"
    ]
    return draw_pictures([comparison, *own, *gait], progress)


def run_numbers(run: TrackRun, simulation: TrialResult | None) -> dict[str, Any]:
    """The numbers of the report, JSON-ready; what is not known is null."""
    return json_ready(
        {
            "distance_m": run.distance,
            "time_over_distance_s": run.time_over_distance,
            **_metric_numbers(run.trial),
            "peak_speed_m_s": run.fix_speed.max(),
            "simulation": simulation and {**_metric_numbers(simulation), **_comparison(run, simulation)},
        }
    )


def _metric_numbers(trial: TrialResult) -> dict[str, Any]:
    return {
        **quantity_numbers(lambda field: getattr(trial.metrics, field)),
        "envelope_share": trial.metrics.envelope_share,
        "fell": not trial.completed,
    }


def _comparison(run: TrackRun, simulation: TrialResult) -> dict[str, Any]:
    """The simulation's time over the distance; robot minus simulation at the receiver's moments."""
    motion = figures.recorded(simulation)
    finish = finish_time(motion.time, motion.qpos[:, 0] - motion.qpos[0, 0], run.distance)
    inside = (run.fix_time >= motion.time[0]) & (run.fix_time <= motion.time[-1])
    gap = run.fix_speed[inside] - np.interp(run.fix_time[inside], motion.time, _receiver_speed(motion))
    return {
        "time_over_distance_s": finish - command_start(motion.time, motion.command[:, 0]),
        "speed_difference_rms_m_s": np.sqrt(np.mean(gap**2)),
        "speed_difference_mean_m_s": gap.mean(),
    }


def render_run_report(
    run: TrackRun,
    simulation: TrialResult | None,
    pictures: Sequence[Picture],
    facts: Sequence[tuple[str, str]],
) -> str:
    """The HTML text: everything inside, nothing loaded from elsewhere."""
    return page_template("run_report.html.j2").render(
        title="A run on the robot",
        rows=list(number_rows(run_numbers(run, simulation))),
        compared=simulation is not None,
        figures=[embedded(picture) for picture in pictures],
        told=[(name.replace("_", " "), value) for name, value in facts],
    )


def number_rows(numbers: dict[str, Any]) -> Iterator[tuple[str, str, str, str]]:
    """One row a number: its name, robot beside simulation, unit."""
    simulated = numbers["simulation"] or {}
    for name, key, digits, unit in (
        (f"time over {numbers['distance_m']:g} m", "time_over_distance_s", 2, "s"),
        *((quantity.name, quantity.key, quantity.digits, quantity.unit) for quantity in QUANTITIES),
        ("robot minus simulation, root mean square", "speed_difference_rms_m_s", 2, "m/s"),
        ("robot minus simulation, mean", "speed_difference_mean_m_s", 2, "m/s"),
    ):
        values = [side.get(key) for side in (numbers, simulated)]
        if values != [None, None]:
            robot, simulation = (number(float("nan") if v is None else v, digits) for v in values)
            yield name, robot, simulation, unit
