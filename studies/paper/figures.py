"""The paper's figures, drawn from our own policies."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import NDArray

from sprintlab.core.theme import (
    LIGHT,
    Theme,
    figure_legend,
    labelled,
    set_title,
    style_axis,
    themed_figure,
)
from sprintlab.core.thinning import moving_average
from sprintlab.evaluation.estimates import estimate_pair
from sprintlab.evaluation.figures import on_envelope, recorded
from sprintlab.evaluation.results import SprintResult, Trajectory, TrialResult
from sprintlab.motors import MotorModel, no_load_speed, torque_limits, voltage_infeasible
from sprintlab.robots import RobotDescription
from studies.paper.command_modes import CommandSequence
from studies.paper.paper import PAPER_TABLE
from studies.paper.record import EvaluationRecord
from studies.paper.table import collapsed
from studies.paper.training_cloud import TrainingCloud

Array = NDArray[np.float64]

MODEL_NAMES: dict[str, str] = {
    "square": "square (ideal motor)",
    "simplified-dc": "v_d = 0",
    "refined": "refined",
}
METHOD_COLOURS = {
    "baseline": "#667085",
    "no-envelope": "#d92d20",
    "simplified-dc": "#e08600",
    "fixed-acceleration": "#7a5af8",
    "uniform-commands": "#0e9384",
    "sprint": "#0b6bcb",
    "actuator-network": "#b54708",
    "after-hacl": "#12855b",
    "flux-weakening": "#c11574",
    "hound": "#98a2b3",
    "literal-acs": "#344054",
    "lp-acrl": "#66b2a0",
    "no-saturation": "#4e5ba6",
    "rlvrl": "#b8860b",
    "spot-battery": "#9e77ed",
    "stride-prior": "#e31b54",
}
"""One colour a method in every figure; each is legible on white and on black."""
_STYLES: dict[str, Any] = {"square": ":", "simplified-dc": "--", "refined": "-"}
_SMOOTHING = 0.2  # [s], about one stride
_POINTS = 2500  # of a cloud that are drawn
_SHOWN_ROBOTS = 24  # of a training whose speeds are drawn
_HIND = {"hind hips": ("RL_hip", "RR_hip"), "hind knees": ("RL_knee", "RR_knee")}


def envelope_figure(robot: RobotDescription, theme: Theme = LIGHT) -> Figure:
    """Torque limits of the motor models on the robot's bus, on the joint's side; the paper's Fig. 1.

    Shaded: what the model without d-axis voltage allows and the real motor cannot give.
    """
    figure, axes = themed_figure(theme, (9.5, 3.9), 1, 3, sharey=True)
    for axis, (kind, joint) in zip(axes, (("abduction", 0), ("hip", 1), ("knee", 2)), strict=True):
        speed, limits = _joint_limits(robot, joint)
        for model, (lower, upper) in limits.items():
            style = {"color": theme.foreground, "linestyle": _STYLES[model], "linewidth": 1.2}
            axis.plot(speed, upper, label=MODEL_NAMES[model], **style)
            axis.plot(speed, lower, **style)
        _shade_impossible(axis, speed, limits, theme)
        axis.axhline(0.0, color=theme.muted, linewidth=0.6)
        set_title(axis, kind, theme)
        axis.set_xlabel("joint speed [rad/s]")
    axes[0].set_ylabel("joint torque [N m]")
    figure_legend(figure, theme, labelled(axes[0]))
    return figure


def _shade_impossible(
    axis: Axes, speed: Array, limits: dict[MotorModel, tuple[Array, Array]], theme: Theme
) -> None:
    """What the model without d-axis voltage allows beyond the refined one."""
    (lower, upper), (simple_lower, simple_upper) = limits["refined"], limits["simplified-dc"]
    style = {"color": theme.second, "alpha": 0.25, "linewidth": 0}
    known = np.isfinite(upper)
    axis.fill_between(speed, upper, simple_upper, where=known & (simple_upper > upper), **style)
    axis.fill_between(speed, simple_lower, lower, where=known & (simple_lower < lower), **style)
    axis.fill_between(speed, simple_lower, simple_upper, where=~known, **style)


def _joint_limits(
    robot: RobotDescription, joint: int, reach: float = 1.12
) -> tuple[Array, dict[MotorModel, tuple[Array, Array]]]:
    """Speeds from rest to past the no-load speed, and the limits of every model there, joint side.

    The refined limits are ``nan`` where no current fits the voltage.
    """
    ratio = float(np.asarray(robot.gear.ratio)[joint])
    gain = ratio * float(np.broadcast_to(robot.gear.efficiency, (12,))[joint])
    top = float(np.asarray(no_load_speed(robot.motors, robot.bus_voltage))[joint]) / ratio
    speed = np.linspace(-reach * top, reach * top, 2001)
    motor_speed = np.tile(speed[:, None] * ratio, (1, 12))
    beyond = np.asarray(voltage_infeasible(robot.motors, motor_speed, robot.bus_voltage))[:, joint]
    limits: dict[MotorModel, tuple[Array, Array]] = {}
    for model in ("square", "simplified-dc", "refined"):
        lower, upper = torque_limits(robot.motors, motor_speed, robot.bus_voltage, model=model)
        hidden = beyond if model == "refined" else np.zeros_like(beyond)
        values = (np.broadcast_to(limit, motor_speed.shape)[:, joint] * gain for limit in (lower, upper))
        low, high = (np.where(hidden, np.nan, value) for value in values)
        limits[model] = (low, high)
    return speed, limits


def worlds_figure(
    worlds: Sequence[tuple[str, TrialResult]], robot: RobotDescription, theme: Theme = LIGHT
) -> Figure:
    """The same policy in several worlds side by side: speed, and what hind hips and knees are asked for.

    Args:
        worlds: heading and trial of each world.
        robot: for the envelopes.
        theme: colours.
    """
    figure, axes = themed_figure(theme, (4.6 * len(worlds), 8.2), 3, len(worlds), sharex="row", sharey="row")
    for column, (heading, trial) in enumerate(worlds):
        _draw_speed(axes[column], trial, theme)
        set_title(axes[column], heading, theme)
        _remark(axes[column], _held_text(trial), theme)
        for row, (name, joints) in enumerate(_HIND.items(), start=1):
            axis = axes[row * len(worlds) + column]
            _draw_cloud(axis, _trial_points(recorded(trial), robot, joints), robot, joints, theme)
            set_title(axis, name, theme)
    axes[0].set_ylabel("forward speed [m/s]")
    for row in (1, 2):
        axes[row * len(worlds)].set_ylabel("joint torque [N m]")
    _cloud_legend(figure, theme)
    return figure


def sprint_figure(sprint: SprintResult, robot: RobotDescription, theme: Theme = LIGHT) -> Figure:
    """Speed over time of a run over a distance, and the clouds of hind hips and knees below it."""
    figure = Figure(figsize=(9.5, 7.0), facecolor=theme.background, layout="constrained")
    axes = figure.subplot_mosaic([["speed", "speed"], list(_HIND)])
    for axis in axes.values():
        style_axis(axis, theme)
    _draw_speed(axes["speed"], sprint.trial, theme)
    axes["speed"].set_ylabel("forward speed [m/s]")
    set_title(axes["speed"], _time_text(sprint), theme)
    _note(axes["speed"], _held_text(sprint.trial), theme)
    for name, joints in _HIND.items():
        points = _trial_points(recorded(sprint.trial), robot, joints)
        _draw_cloud(axes[name], points, robot, joints, theme)
        set_title(axes[name], name, theme)
        axes[name].set_ylabel("joint torque [N m]")
    _cloud_legend(figure, theme)
    return figure


@dataclass(frozen=True, kw_only=True)
class BothWorlds:
    """A policy in its training and in the evaluation.

    Attributes:
        method: its name.
        training: what the motors of the training's robots did.
        sprint: a run over a distance in the evaluation.
    """

    method: str
    training: TrainingCloud
    sprint: SprintResult


def clouds_figure(methods: Sequence[BothWorlds], robot: RobotDescription, theme: Theme = LIGHT) -> Figure:
    """Speeds over time, and the clouds of hind hips and knees below: in training and in the evaluation.

    Args:
        methods: two columns each, side by side.
        robot: for the envelopes.
        theme: colours.
    """
    width = 2 * len(methods)
    size = (4.6 * width if width == 2 else 3.7 * width, 8.2)
    figure, axes = themed_figure(theme, size, 3, width, sharey="row")
    grid = np.reshape(np.array(axes, dtype=object), (3, width))
    for index, method in enumerate(methods):
        _draw_training(grid[:, 2 * index], method, robot, theme)
        _draw_evaluation(grid[:, 2 * index + 1], method, robot, theme)
    for axis, label in zip(grid[:, 0], ("forward speed [m/s]", *["joint torque [N m]"] * 2), strict=True):
        axis.set_ylabel(label)
    _cloud_legend(figure, theme)
    return figure


def _draw_training(axes: NDArray[Any], method: BothWorlds, robot: RobotDescription, theme: Theme) -> None:
    """One column: some robots of the training, then the clouds of all of them."""
    cloud = method.training
    shown = cloud.forward_speed[:, :: -(-cloud.forward_speed.shape[1] // _SHOWN_ROBOTS)]
    axes[0].plot(cloud.time, shown, color=theme.speed, linewidth=0.8, alpha=0.6)
    axes[0].set_xlabel("time [s]")
    set_title(axes[0], f"{method.method}: training", theme)
    _note(axes[0], MODEL_NAMES.get(cloud.motor_model, cloud.motor_model), theme)
    _remark(axes[0], f"fastest of {cloud.forward_speed.shape[1]}: {cloud.forward_speed.max():.1f} m/s", theme)
    for axis, (name, joints) in zip(axes[1:], _HIND.items(), strict=True):
        _draw_cloud(axis, _training_points(cloud, robot, joints), robot, joints, theme)
        set_title(axis, name, theme)


def _draw_evaluation(axes: NDArray[Any], method: BothWorlds, robot: RobotDescription, theme: Theme) -> None:
    """One column: the run over a distance, then its clouds."""
    sprint = method.sprint
    _draw_speed(axes[0], sprint.trial, theme)
    set_title(axes[0], f"{method.method}: evaluation", theme)
    _note(axes[0], MODEL_NAMES["refined"], theme)
    _remark(axes[0], _time_text(sprint), theme)
    for axis, (name, joints) in zip(axes[1:], _HIND.items(), strict=True):
        points = _trial_points(recorded(sprint.trial), robot, joints)
        _draw_cloud(axis, points, robot, joints, theme)
        set_title(axis, name, theme)


def _draw_speed(axis: Axes, trial: TrialResult, theme: Theme) -> None:
    trajectory = recorded(trial)
    axis.plot(trajectory.time, trajectory.command[:, 0], color=theme.command, linewidth=1.1, linestyle="--")
    axis.plot(trajectory.time, trajectory.velocity[:, 0], color=theme.speed, linewidth=0.5, alpha=0.4)
    speed = moving_average(trajectory.velocity[:, 0], trajectory.time, _SMOOTHING)
    axis.plot(trajectory.time, speed, color=theme.speed, linewidth=1.7)
    axis.set_xlabel("time [s]")
    if trial.fall_time is not None:
        axis.axvline(trial.fall_time, color=theme.on_limit, linewidth=1.4)
        axis.text(
            trial.fall_time,
            0.06,
            f"fell: {trial.fall_reason} ",
            color=theme.on_limit,
            fontsize=8,
            ha="right",
            transform=axis.get_xaxis_transform(),
        )


def _time_text(sprint: SprintResult) -> str:
    return f"{sprint.distance:g} m in {sprint.time:.2f} s" if sprint.finished else "not finished"


def _held_text(trial: TrialResult) -> str:
    held = trial.metrics.held_speed
    return f"held {held:.2f} m/s" if math.isfinite(held) else ""


def _note(axis: Axes, text: str, theme: Theme) -> None:
    """A remark to the right above the axes."""
    axis.set_title(text, loc="right", fontsize=8.5, color=theme.muted)


def _remark(axis: Axes, text: str, theme: Theme) -> None:
    """A remark in the middle of the lower edge, inside the axes."""
    axis.text(0.5, 0.06, text, color=theme.foreground, fontsize=8.5, ha="center", transform=axis.transAxes)


@dataclass(frozen=True, kw_only=True)
class _Points:
    """Samples of some joints, each ``(k,)``, joint side.

    ``torque`` is before saturation [N m], ``limited`` tells where it sits on the limit in force, ``allowed``
    where the refined model allows it.
    """

    speed: Array
    torque: Array
    limited: NDArray[np.bool_]
    allowed: NDArray[np.bool_]


def _columns(robot: RobotDescription, joints: Sequence[str]) -> tuple[list[int], Array]:
    """Places of the joints, and what turns motor torque into joint torque."""
    indices = [robot.joint_names.index(name) for name in joints]
    gain = np.asarray(robot.gear.ratio) * np.broadcast_to(robot.gear.efficiency, (12,))
    return indices, gain[indices]


def _trial_points(trajectory: Trajectory, robot: RobotDescription, joints: Sequence[str]) -> _Points:
    indices, gain = _columns(robot, joints)
    lower, upper = torque_limits(
        robot.motors, trajectory.joint_velocity * np.asarray(robot.gear.ratio), robot.bus_voltage
    )
    inside = (trajectory.motor_torque <= upper + 1e-3) & (trajectory.motor_torque >= lower - 1e-3)
    return _Points(
        speed=trajectory.joint_velocity[:, indices].ravel(),
        torque=(trajectory.motor_torque[:, indices] * gain).ravel(),
        limited=on_envelope(trajectory, robot)[:, indices].ravel(),
        allowed=inside[:, indices].ravel(),
    )


def impossible_shares(trial: TrialResult, robot: RobotDescription) -> dict[str, float]:
    """Share of the torques of hind hips and hind knees that the refined motor could not give.

    Args:
        trial: with its trajectory, whatever motor ran it.
        robot: for the envelope.
    """
    points = {name: _trial_points(recorded(trial), robot, joints) for name, joints in _HIND.items()}
    return {name: float(np.mean(~found.allowed)) for name, found in points.items()}


def _training_points(cloud: TrainingCloud, robot: RobotDescription, joints: Sequence[str]) -> _Points:
    indices, gain = _columns(robot, joints)
    return _Points(
        speed=cloud.joint_velocity[..., indices].ravel(),
        torque=(cloud.motor_torque(robot)[..., indices] * gain).ravel(),
        limited=cloud.on_limit[..., indices].ravel().astype(bool),
        allowed=~cloud.impossible(robot)[..., indices].ravel(),
    )


def _draw_cloud(
    axis: Axes, points: _Points, robot: RobotDescription, joints: Sequence[str], theme: Theme
) -> None:
    """Torque against speed on the joint's side, what the refined model forbids in red."""
    speed, torque, limited, allowed = points.speed, points.torque, points.limited, points.allowed
    for mask, colour in (
        (allowed & ~limited, theme.inside),
        (allowed & limited, theme.foreground),
        (~allowed, theme.on_limit),
    ):
        mask = mask & (np.arange(len(mask)) % (len(mask) // _POINTS + 1) == 0)
        axis.scatter(speed[mask], torque[mask], s=2.0, color=colour, alpha=0.5, linewidths=0, rasterized=True)
    places, limits = _joint_limits(robot, robot.joint_names.index(joints[0]), reach=1.3)
    for model, (low, high) in limits.items():
        for limit in (low, high):
            axis.plot(places, limit, color=theme.muted, linestyle=_STYLES[model], linewidth=1.0)
    _note(
        axis, f"{100 * limited.mean():.0f} % on the limit, {100 * np.mean(~allowed):.0f} % impossible", theme
    )
    axis.set_xlabel("joint speed [rad/s]")


def _cloud_legend(figure: Figure, theme: Theme) -> None:
    marks: list[Any] = [
        Line2D([], [], color=theme.speed, linewidth=1.7, label="speed, mean over 0.2 s"),
        Line2D([], [], color=theme.command, linestyle="--", linewidth=1.1, label="speed command"),
    ]
    marks += [
        Line2D([], [], color=colour, marker="o", markersize=4, linestyle="", label=label)
        for colour, label in (
            (theme.inside, "inside the real envelope"),
            (theme.foreground, "on the limit in force"),
            (theme.on_limit, "impossible for the real motor"),
        )
    ]
    marks += [
        Line2D([], [], color=theme.muted, linestyle=_STYLES[model], label=name)
        for model, name in MODEL_NAMES.items()
    ]
    figure_legend(figure, theme, marks, columns=4)


def commands_figure(runs: Sequence[tuple[CommandSequence, TrialResult]], theme: Theme = LIGHT) -> Figure:
    """One policy under every command update mode: target, command, speed, and how much the trunk rocks.

    Args:
        runs: course and run of each mode.
        theme: colours.
    """
    figure, axes = themed_figure(theme, (9.5, 2.1 * len(runs)), len(runs), 1, sharex=True, sharey=True)
    for axis, (course, trial) in zip(axes, runs, strict=True):
        trajectory = recorded(trial)
        target = np.array([course.target(time) for time in trajectory.time])
        axis.plot(trajectory.time, target, color=theme.second, linewidth=0.9, linestyle=":")
        _draw_speed(axis, trial, theme)
        error = float(np.abs(target - trajectory.velocity[:, 0]).mean())
        end = "fell" if trial.fall_time is not None else "no fall"
        set_title(axis, course.mode, theme)
        cost = trial.metrics.angular_cost
        _note(axis, f"{end}, mean distance to the target {error:.2f} m/s, J {cost:.2f} rad²/s", theme)
        axis.set_ylabel("speed [m/s]")
        axis.set_xlabel("")
    axes[-1].set_xlabel("time [s]")
    handles = [
        Line2D([], [], color=theme.second, linestyle=":", label="target"),
        Line2D([], [], color=theme.command, linestyle="--", label="command"),
        Line2D([], [], color=theme.speed, label="speed"),
    ]
    figure_legend(figure, theme, handles)
    return figure


def estimate_figure(trial: TrialResult, theme: Theme = LIGHT) -> Figure:
    """A policy's estimate against the truth over a run: speed, sideways speed, height, one foot's contact."""
    pair = estimate_pair(recorded(trial))
    panels = (
        ("forward velocity [m/s]", 0),
        ("sideways velocity [m/s]", 1),
        ("vertical velocity [m/s]", 2),
        ("base height [m]", 3),
        ("contact, front left", 4),
    )
    figure, axes = themed_figure(theme, (9.5, 8.0), len(panels), 1, sharex=True)
    for axis, (label, column) in zip(axes, panels, strict=True):
        axis.plot(pair.time, pair.truth[:, column], color=theme.muted, linewidth=1.0, label="simulated")
        axis.plot(pair.time, pair.estimate[:, column], color=theme.second, linewidth=1.2, label="estimate")
        axis.set_ylabel(label, fontsize=8)
    axes[-1].set_xlabel("time [s]")
    figure_legend(figure, theme, labelled(axes[0]))
    return figure


def methods_figure(records: Mapping[str, Sequence[EvaluationRecord]], theme: Theme = LIGHT) -> Figure:
    """The most held, raw: every seed as a dot, a method's mean as a bar, the paper's number as a mark."""
    names = [method for method in records if records[method] or method in PAPER_TABLE]
    figure, axes = themed_figure(theme, (9.5, 1.2 + 0.32 * len(names)), 1, 1)
    axis = axes[0]
    for place, method in enumerate(names):
        values = [record.raw.most_held for record in records[method] if not collapsed(record)]
        if values:
            colour = method_colour(method, theme)
            axis.barh(place, float(np.mean(values)), 0.6, color=colour, alpha=0.3)
            apart = place + np.linspace(-0.16, 0.16, len(values)) * (len(values) > 1)
            axis.plot(values, apart, "o", color=colour, markersize=4)
        paper = PAPER_TABLE.get(method)
        if paper is not None and paper.max_velocity is not None:
            axis.plot(
                [paper.max_velocity] * 2, [place - 0.35, place + 0.35], color=theme.foreground, linewidth=1.5
            )
        if note := _missing_text(len(records[method]), len(values)):
            axis.text(0.1, place, note, va="center", fontsize=8, color=theme.foreground)
    axis.set_yticks(range(len(names)), names)
    axis.set_ylim(len(names) - 0.4, -0.6)
    axis.set_xlabel("most held, raw [m/s]")
    handles = [
        Line2D([], [], color=theme.muted, marker="o", linestyle="", label="ours, one seed"),
        Patch(color=theme.muted, alpha=0.3, label="ours, mean"),
        Line2D([], [], color=theme.foreground, label="the paper's robot"),
    ]
    figure_legend(figure, theme, handles)
    return figure


def method_colour(method: str, theme: Theme) -> str:
    """The method's colour in every figure; that of text for a method that is not the paper's."""
    return METHOD_COLOURS.get(method, theme.foreground)


def _missing_text(seeds: int, running: int) -> str:
    """Why there are fewer dots than seeds."""
    if not seeds:
        return "not trained"
    return f"{seeds - running} of {seeds} collapsed" if running < seeds else ""


def learning_figure(curves: Mapping[str, Sequence[Mapping[str, Array]]], theme: Theme = LIGHT) -> Figure:
    """Speed of the fastest robots over training time: mean and range over the seeds of each method.

    Args:
        curves: method to the curves of its seeds, each with ``seconds`` and ``speed_p999``.
        theme: colours.
    """
    figure, axes = themed_figure(theme, (9.5, 4.2), 1, 1)
    axis = axes[0]
    for method, seeds in curves.items():
        colour = method_colour(method, theme)
        end = min(float(curve["seconds"][-1]) for curve in seeds)
        time = np.linspace(0.0, end, 300)
        values = np.stack([np.interp(time, curve["seconds"], curve["speed_p999"]) for curve in seeds])
        line = "-" if method in PAPER_TABLE else "--"
        axis.plot(time / 60.0, values.mean(axis=0), line, color=colour, linewidth=1.6, label=method)
        axis.fill_between(time / 60.0, values.min(axis=0), values.max(axis=0), color=colour, alpha=0.15)
    axis.set_xlabel("training time [min]")
    axis.set_ylabel("speed, 99.9th percentile [m/s]")
    figure_legend(figure, theme, labelled(axis), columns=5)
    return figure
