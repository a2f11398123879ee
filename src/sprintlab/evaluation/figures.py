"""The pictures of a race: what the robot did, and how close its motors were to their limits.

Every function takes plain results and returns a matplotlib ``Figure``.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from sprintlab.core.array_types import Array
from sprintlab.core.errors import SimulationError
from sprintlab.core.smoothing import moving_average
from sprintlab.core.theme import LIGHT, figure_legend, legend_above, set_title, themed_figure
from sprintlab.evaluation.metrics import copper_losses, cost_so_far, joint_power, on_envelope, stances
from sprintlab.evaluation.results import SprintResult, Trajectory, TrialResult, require_finite
from sprintlab.motors import no_load_speed, torque_limits, voltage_infeasible
from sprintlab.robots import RobotDescription, joint_kind

JOINT_TITLES = {"abad": "abduction", "hip": "hip", "knee": "knee", "waist": "waist"}
GAIT_WINDOW = 1.0  # seconds of the hold that the gait diagram shows
POWER_WINDOW = 0.2  # seconds of the moving average of power, about one stride
ON_LIMIT_MARGIN = 1e-3  # share of the peak torque within which a sample counts as on the envelope

_MOST_DOTS = 50_000  # of a cloud
_SPLIT = 10.0  # [m] between the times that the figure of a sprint tells


def recorded(trial: TrialResult) -> Trajectory:
    """The trajectory of a trial, checked.

    Raises:
        SimulationError: the trial kept none, or it holds NaN.
    """
    if trial.trajectory is None or len(trial.trajectory.time) < 2:
        raise SimulationError("the trial kept no trajectory, so there is nothing to draw")
    require_finite(trial.trajectory)
    return trial.trajectory


def draw_curve(axis: Axes, time: Array, values: Array, color: str, **look: Any) -> None:
    """A curve over time."""
    axis.plot(time, values, color=color, **look)


def speed_figure(raw: TrialResult, self_paced: TrialResult) -> Figure:
    """Speed against command over time, the raw profile above the self-paced one."""
    figure, axes = themed_figure(LIGHT, (9.5, 6.2), 2, 1, sharex=True, sharey=True)
    for axis, trial, title in zip(
        axes, (raw, self_paced), ("Raw command", "Self-paced command"), strict=True
    ):
        _draw_speed(axis, trial)
        set_title(axis, title, LIGHT)
        axis.set_ylabel("forward speed [m/s]")
    ends = (max(float(recorded(trial).time[-1]), trial.hold_interval[1]) for trial in (raw, self_paced))
    axes[-1].set(xlabel="time [s]", xlim=(0.0, max(ends)))
    legend_above(axes[0], LIGHT)
    return figure


def sprint_figure(raw: SprintResult, self_paced: SprintResult) -> Figure:
    """Speed over distance, with the time at every ten metres."""
    figure, (axis,) = themed_figure(LIGHT, (9.5, 3.9), 1, 1)
    looks = ((raw, "raw", LIGHT.speed, 0.13), (self_paced, "self-paced", LIGHT.second, 0.04))
    splits = np.arange(_SPLIT, raw.distance + 0.5 * _SPLIT, _SPLIT)
    for sprint, name, colour, height in looks:
        motion = recorded(sprint.trial)
        start = int(np.argmax(np.abs(motion.profile_speed) > 1e-9))
        distance, speed = motion.qpos[start:, 0] - motion.qpos[0, 0], motion.velocity[start:, 0]
        ended = f"{sprint.distance:g} m in {sprint.time:.2f} s"
        if not sprint.finished:
            ended = f"stopped after {sprint.trial.metrics.distance:.0f} m"
        axis.plot(distance, speed, color=colour, label=f"{name}: {ended}")
        for split in splits[splits <= distance.max()].tolist():
            moment = motion.time[start + int(np.argmax(distance >= split))] - motion.time[start]
            place: Any = {"ha": "center", "transform": axis.get_xaxis_transform()}
            axis.text(split, height, f"{moment:.1f}", color=colour, fontsize=8, **place)
    axis.set(xlim=(0.0, raw.distance), ylim=(0.0, None), ylabel="forward speed [m/s]")
    axis.set_xticks([0.0, *splits])
    axis.set_xlabel("distance of the base [m]   (numbers above the axis: seconds since the first command)")
    legend_above(axis, LIGHT)
    return figure


def torque_speed_figure(trial: TrialResult, robot: RobotDescription) -> Figure:
    """Torque-speed clouds of all joints, motor side, over the refined envelope.

    Filled: refined envelope (d-axis voltage in); dashed: v_d = 0; dotted: square box. A sample is drawn
    as "on the envelope" when its torque equals a limit while the robot is commanded to move.
    """
    trajectory = recorded(trial)
    kinds = list(dict.fromkeys(map(joint_kind, robot.joint_names)))
    rows, columns = len(kinds), len(robot.leg_names)
    figure, axes = themed_figure(LIGHT, (11.0, 0.8 + 2.4 * rows), rows, columns, sharex="row", sharey="row")
    speed = trajectory.joint_velocity * np.asarray(robot.gear.ratio)
    curves = _envelope_curves(robot, speed)
    limited = on_envelope(trajectory, ON_LIMIT_MARGIN * np.asarray(robot.motors.peak_torque))
    for axis in axes[len(robot.joint_names) :]:
        axis.set_visible(False)
    for joint, name in enumerate(robot.joint_names):
        kind = joint_kind(name)
        leg, _, _ = name.rpartition("_")
        axis = axes[kinds.index(kind) * columns + (robot.leg_names.index(leg) if leg else 0)]
        _draw_envelope(axis, curves, joint)
        draw_cloud(axis, speed[:, joint], trajectory.motor_torque[:, joint], limited[:, joint])
        share = trial.metrics.envelope_share[joint]
        set_title(axis, f"{leg} {JOINT_TITLES[kind]}".strip(), LIGHT)
        axis.set_title(f"{100 * share:.0f} % on limit", loc="right", fontsize=8, color=LIGHT.muted)
    for axis in axes[::columns]:
        axis.set_ylabel("motor torque before\nsaturation [N m]")
    for axis in axes[-columns:]:
        axis.set_xlabel("motor speed [rad/s]")
    _envelope_legend(figure)
    return figure


def gait_figure(trial: TrialResult, robot: RobotDescription) -> Figure:
    """Foot contacts over the last second of the hold; the time with no foot down is shaded as flight."""
    trajectory = recorded(trial)
    figure, (axis,) = themed_figure(LIGHT, (9.5, 3.2), 1, 1)
    end = min(trial.hold_interval[1], float(trajectory.time[-1]))
    window = (trajectory.time >= end - GAIT_WINDOW) & (trajectory.time <= end)
    time, contact = trajectory.time[window], trajectory.foot_contact[window].astype(bool)
    flight: Array = np.logical_not(np.any(contact, axis=1))
    for start, width in _spans(time, flight):
        axis.axvspan(start, start + width, color=LIGHT.shade, zorder=0, linewidth=0)
    rows = np.arange(len(robot.leg_names))[::-1]
    for row, color, touching in zip(rows, LIGHT.legs, contact.T, strict=False):
        axis.broken_barh(_spans(time, touching), (row - 0.32, 0.64), color=color)
    duty = contact.mean(axis=0)
    labels = [f"{name}  {100 * share:.0f} %" for name, share in zip(robot.leg_names, duty, strict=True)]
    axis.set_yticks(rows, labels)
    axis.set(ylim=(-0.6, rows[0] + 0.6), xlim=(end - GAIT_WINDOW, end), xlabel="time [s]")
    axis.grid(False, axis="y")
    strides, flying = trial.metrics.stride_frequency, 100 * float(np.mean(flight))
    told = [f"{strides:.1f} strides a second"] if np.isfinite(strides) else []
    told += [f"{flying:.0f} % of the time in flight (shaded)", "left: share of time on the ground"]
    axis.set_title(" · ".join(told), loc="left", fontsize=9, color=LIGHT.muted)
    return figure


def rates_figure(trial: TrialResult) -> Figure:
    """Roll and pitch rate of the base, and the cost J that grows with their squares."""
    trajectory = recorded(trial)
    time, rates = trajectory.time, trajectory.angular_velocity[:, :2]
    figure, axes = themed_figure(LIGHT, (9.5, 6.4), 3, 1, sharex=True)
    limit = 1.05 * float(np.abs(rates).max() + 1e-6)
    names = (("roll rate", LIGHT.speed), ("pitch rate", LIGHT.second))
    for axis, rate, (name, colour) in zip(axes, rates.T, names, strict=False):
        draw_curve(axis, time, rate, colour, linewidth=0.8)
        axis.axhline(0.0, color=LIGHT.muted, linewidth=0.6)
        axis.set(ylabel=f"{name} [rad/s]", ylim=(-limit, limit))
    draw_curve(axes[2], time, cost_so_far(trajectory), LIGHT.foreground)
    axes[2].set(ylabel="J so far [rad²/s]", xlabel="time [s]", ylim=(0.0, None))
    for axis in axes:
        _shade_hold(axis, trial)
    axes[0].set_xlim(time[0], time[-1])
    return figure


def power_figure(trial: TrialResult, robot: RobotDescription) -> Figure:
    """Mechanical power and copper loss: over time, and by joint during the hold."""
    trajectory = recorded(trial)
    mechanical, copper = joint_power(trajectory), copper_losses(trajectory, robot)
    figure, (over_time, by_joint) = themed_figure(LIGHT, (9.5, 6.4), 2, 1, height_ratios=(1.25, 1.0))
    _draw_power(over_time, trajectory.time, mechanical.sum(axis=1), copper.sum(axis=1))
    _shade_hold(over_time, trial)
    begin, end = trial.hold_interval
    held = (trajectory.time >= begin) & (trajectory.time <= end)
    held = held if held.any() else ~held
    _draw_power_by_joint(by_joint, mechanical[held], copper[held], robot.joint_names)
    for axis in (over_time, by_joint):
        legend_above(axis, LIGHT)
    return figure


# --- drawing ---------------------------------------------------------------------------------------------


def _shade_hold(axis: Axes, trial: TrialResult) -> None:
    axis.axvspan(*trial.hold_interval, color=LIGHT.shade, zorder=0, linewidth=0)
    if trial.fall_time is not None:
        axis.axvline(trial.fall_time, color=LIGHT.on_limit, linewidth=1.2, linestyle="--")


def _draw_speed(axis: Axes, trial: TrialResult) -> None:
    trajectory, end, held = recorded(trial), trial.hold_interval[1], trial.metrics.held_speed
    time = trajectory.time
    _shade_hold(axis, trial)
    draw_curve(
        axis, time, trajectory.profile_speed, LIGHT.muted, linewidth=1.0, linestyle=":", label="profile"
    )
    command = trajectory.command[:, 0]
    draw_curve(axis, time, command, LIGHT.command, linewidth=1.3, label="command to the policy")
    draw_curve(axis, time, trajectory.velocity[:, 0], LIGHT.speed, linewidth=1.6, label="measured speed")
    if np.isfinite(held):
        axis.plot([end - 2.0, end], [held, held], color=LIGHT.second, linewidth=2.4, solid_capstyle="butt")
        look: Any = {"color": LIGHT.second, "fontsize": 9, "fontweight": "bold", "ha": "center"}
        place = (end - 1.0, held)
        axis.annotate(f"held {held:.2f} m/s", place, (0, -16), textcoords="offset points", **look)
    if trial.fall_time is not None:
        label = f"fell: {trial.fall_reason} "
        axis.text(trial.fall_time, 0.5, label, color=LIGHT.on_limit, fontsize=9, ha="right")


def _envelope_curves(robot: RobotDescription, speed: Array) -> dict[str, Any]:
    """Speeds ``(n, joints)`` that cover the cloud, and the limits of the three models on them.

    NaN, which is not drawn, where no current fits the voltage.
    """
    motors, bus_voltage = robot.motors, robot.bus_voltage
    top = 1.08 * np.maximum(np.abs(speed).max(axis=0), np.asarray(no_load_speed(motors, bus_voltage)))
    grid = np.linspace(-1.0, 1.0, 401)[:, None] * top
    curves: dict[str, Any] = {"speed": grid}
    for model in ("refined", "simplified-dc", "square"):
        curves[model] = np.array(torque_limits(motors, grid, bus_voltage, model=model))
    curves["refined"][:, np.asarray(voltage_infeasible(motors, grid, bus_voltage))] = np.nan
    return curves


def _draw_envelope(axis: Axes, curves: dict[str, Any], joint: int) -> None:
    speed = curves["speed"][:, joint]
    for model, style in (("square", ":"), ("simplified-dc", "--")):
        axis.plot(
            speed, curves[model][..., joint].T, color=LIGHT.muted, linewidth=0.9, linestyle=style, zorder=1
        )
    lower, upper = curves["refined"][..., joint]
    axis.fill_between(speed, lower, upper, color=LIGHT.envelope, linewidth=0, zorder=0)
    axis.plot(speed, np.stack((lower, upper), axis=1), color=LIGHT.foreground, linewidth=1.1, zorder=3)


def draw_cloud(axis: Axes, speed: Array, torque: Array, limited: Array) -> None:
    """Samples ``(T,)`` of one joint: speeds [rad/s], torques [N m], those on their limit in red."""
    look: Any = {"alpha": 0.45, "linewidths": 0, "zorder": 2, "rasterized": True}
    kept = slice(None, None, 1 + len(speed) // _MOST_DOTS)
    for mask, colour, size in ((~limited, LIGHT.inside, 1.6), (limited, LIGHT.on_limit, 2.4)):
        axis.scatter(speed[mask][kept], torque[mask][kept], s=size, color=colour, **look)


def _envelope_legend(figure: Figure) -> None:
    fill: Any = {"facecolor": LIGHT.envelope, "edgecolor": LIGHT.foreground}
    handles: list[Any] = [Patch(**fill, label="refined (d-axis voltage included)")]
    handles.append(Line2D([], [], color=LIGHT.muted, linestyle="--", label="v_d = 0"))
    handles.append(Line2D([], [], color=LIGHT.muted, linestyle=":", label="square"))
    for colour, label in ((LIGHT.inside, "inside"), (LIGHT.on_limit, "on the envelope")):
        handles.append(Line2D([], [], color=colour, marker="o", markersize=4, linestyle="", label=label))
    figure_legend(figure, LIGHT, handles)


def _spans(time: Array, mask: Array) -> list[tuple[float, float]]:
    """Start and width of every run of true values."""
    if len(time) < 2:
        return []
    step = float(time[1] - time[0])
    return [(float(time[a]), float(time[b - 1] - time[a]) + step) for a, b in stances(mask).tolist()]


def _draw_power(axis: Axes, time: Array, mechanical: Array, copper: Array) -> None:
    draw_curve(axis, time, mechanical / 1e3, LIGHT.speed, linewidth=0.4, alpha=0.25)
    for values, name, colour in (
        (mechanical, "mechanical", LIGHT.speed),
        (copper, "copper loss", LIGHT.second),
    ):
        label, smooth = f"{name}, mean of {POWER_WINDOW:g} s", moving_average(values, time, POWER_WINDOW)
        draw_curve(axis, time, smooth / 1e3, colour, linewidth=1.6, label=label)
    axis.axhline(0.0, color=LIGHT.muted, linewidth=0.6)
    axis.set(xlim=(time[0], time[-1]), ylabel="power, all joints [kW]", xlabel="time [s]")


def _draw_power_by_joint(axis: Axes, mechanical: Array, copper: Array, names: Sequence[str]) -> None:
    """Bars of the means over samples ``(T, joints)``."""
    place = np.arange(len(names))
    for values, offset, width, colour, label in (
        (np.clip(mechanical, 0, None), -0.2, 0.38, LIGHT.speed, "mechanical, driving"),
        (np.clip(mechanical, None, 0), -0.2, 0.38, LIGHT.muted, "mechanical, braking"),
        (copper, 0.2, 0.3, LIGHT.second, "copper loss"),
    ):
        axis.bar(place + offset, values.mean(axis=0), width, color=colour, label=label)
    axis.set_xticks(place, [name.replace("_", "\n") for name in names])
    axis.axhline(0.0, color=LIGHT.muted, linewidth=0.6)
    axis.set_ylabel("mean during the hold [W]")
