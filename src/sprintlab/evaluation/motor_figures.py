"""Pictures of one motor: its envelopes, and what happens inside them."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from sprintlab.core.array_types import Array
from sprintlab.core.theme import LIGHT, figure_legend, labelled, set_title, themed_figure
from sprintlab.evaluation.operating_points import OperatingPoints
from sprintlab.motors import MOTOR_MODELS, MotorModel, voltage_infeasible
from sprintlab.motors.chart import (
    SATURATED,
    JointDrive,
    end_of_drive,
    envelope_names,
    joint_copper_loss,
    joint_limits,
    peak_torque_speed,
)

LABELS = {
    "refined": "refined",
    "simplified-dc": "v_d = 0",
    "square": "square",
    "flux-weakening": "flux weakening",
    SATURATED: "refined, after saturation",
}
_STYLES = {"refined": "-", "simplified-dc": "--", "square": ":", SATURATED: "-"}
_WIDTHS = {"refined": 2.0, "flux-weakening": 1.3, SATURATED: 1.3}  # without saturation one covers the other
_CURVE_POINTS = 801
_GRID_POINTS = 241
_BISECTIONS = 50
_ROOM = 0.93  # share of the envelope within which a label stays clear of its edge
_WIDEST = 1.6  # times the no-load speed: how much of flux weakening is shown


def workbench_figure(drive: JointDrive, title: str, operated: OperatingPoints | None = None) -> Figure:
    """All envelopes on the left; copper loss and mechanical power inside the refined one on the right.

    Args:
        drive: motor, gear and bus.
        title: printed above the left axes.
        operated: samples drawn over the envelopes; none when left out.
    """
    figure, (models, inside) = themed_figure(LIGHT, (13.0, 5.4), 1, 2, sharex=True, sharey=True)
    top = shown_speed(drive)
    _draw_models(models, drive, top)
    _draw_marks(models, drive)
    _draw_inside(inside, figure, drive, top)
    if operated is not None:
        for axis in (models, inside):
            _draw_points(axis, operated)
    for axis, text in ((models, title), (inside, "Copper loss and mechanical power, after saturation")):
        _finish(axis, text, top, drive)
    models.set_ylabel("joint torque [N m], before saturation but where the legend says after")
    figure_legend(figure, LIGHT, labelled(models), columns=4, place="lower")
    return figure


def shown_speed(drive: JointDrive) -> float:
    """The joint speed at which the axes end [rad/s]: a little beyond the last model that still drives."""
    farthest = _WIDEST * drive.no_load_speed
    ends = [end_of_drive(drive, model) for model in MOTOR_MODELS if model != "square"]
    longest = max(farthest if end is None else end for end in ends)
    return 1.12 * max(min(longest, farthest), drive.no_load_speed)


def _draw_models(axis: Axes, drive: JointDrive, top: float) -> None:
    colours = {"refined": LIGHT.foreground, SATURATED: LIGHT.speed, "flux-weakening": LIGHT.second}
    for name in envelope_names():
        speed = _shown_speeds(drive, name, top, _CURVE_POINTS)
        lower, upper = joint_limits(drive, speed, name)
        look = {
            "color": colours.get(name, LIGHT.muted),
            "linestyle": _STYLES.get(name, "-."),
            "linewidth": _WIDTHS.get(name, 1.0),
        }
        axis.plot(speed, upper, label=LABELS.get(name, name), **look)
        axis.plot(speed, lower, **look)
        if name == SATURATED:
            axis.fill_between(speed, lower, upper, color=LIGHT.envelope, linewidth=0, zorder=0)


def _draw_marks(axis: Axes, drive: JointDrive) -> None:
    """Where the whole peak torque ends, and where the motor runs free."""
    marks: tuple[tuple[MotorModel, str], ...] = (("refined", "o"), ("simplified-dc", "s"))
    for model, marker in marks:
        speed = peak_torque_speed(drive, model)
        if speed:
            label = f"peak torque up to {speed:.1f} rad/s ({LABELS[model]})"
            axis.plot([speed], [drive.peak_torque], marker, color=LIGHT.on_limit, markersize=5, label=label)
    label = f"no-load speed {drive.no_load_speed:.1f} rad/s"
    axis.plot([drive.no_load_speed], [0.0], "D", color=LIGHT.second, markersize=5, label=label)


def _draw_inside(axis: Axes, figure: Figure, drive: JointDrive, top: float) -> None:
    """Filled contours of copper loss, lines of constant mechanical power, inside what the joint can give."""
    across = _shown_speeds(drive, SATURATED, top, _GRID_POINTS)
    lower, upper = joint_limits(drive, across, SATURATED)
    share = np.linspace(0.0, 1.0, _GRID_POINTS)[:, None]
    torque = lower + share * (upper - lower)  # the grid bends with the envelope, so that its edge is smooth
    speed = np.broadcast_to(across, torque.shape)
    loss, power = joint_copper_loss(drive, torque), speed * torque
    filled = axis.contourf(speed, torque, loss, levels=10, cmap="YlOrRd", alpha=0.85)
    for limit in (lower, upper):
        axis.plot(across, limit, color=LIGHT.speed, linewidth=1.3)
    bar = figure.colorbar(filled, ax=axis, pad=0.02)
    bar.set_label("copper loss [W]", color=LIGHT.foreground, fontsize=9)
    bar.ax.tick_params(colors=LIGHT.muted, labelsize=8)
    levels = MaxNLocator(nbins=10).tick_values(float(power.min()), float(power.max()))
    lines = axis.contour(speed, torque, power, levels[levels != 0.0], colors=LIGHT.foreground, linewidths=0.7)
    axis.clabel(lines, fmt="%.0f W", fontsize=7, manual=_label_points(drive, np.asarray(levels), top))


def _label_points(drive: JointDrive, powers: Array, top: float) -> list[tuple[float, float]]:
    """Speed and torque of each power's labels: toward the corner of each quadrant, where there is room."""
    corner = peak_torque_speed(drive, "refined") or drive.no_load_speed
    slope = float(joint_limits(drive, 0.0, SATURATED)[1]) / corner
    points: list[tuple[float, float]] = []
    for power in powers[powers != 0.0].tolist():
        speed = np.sqrt(abs(power) / slope)
        for side in (-1.0, 1.0):
            at, torque = side * speed, side * np.sign(power) * slope * speed
            lower, upper = (_ROOM * limit for limit in joint_limits(drive, at, SATURATED))
            if lower < torque < upper and speed < _ROOM * top:
                points.append((float(at), float(torque)))
    return points


def _shown_speeds(drive: JointDrive, name: str, top: float, count: int) -> Array:
    """Speeds of a curve, as far as a current satisfies the model's voltage limit, dense where it ends."""
    model: MotorModel = "refined" if name == SATURATED else next(m for m in MOTOR_MODELS if m == name)
    end = min(_last_speed(drive, model, top), top)
    return end * np.sin(np.linspace(-0.5 * np.pi, 0.5 * np.pi, count))


def _last_speed(drive: JointDrive, model: MotorModel, top: float) -> float:
    """Where the voltage limit leaves no current, by bisection; ``top`` where it leaves one there."""

    def fits(speed: float) -> bool:
        return not voltage_infeasible(drive.motor, speed * drive.gear.ratio, drive.bus_voltage, model)

    inside, outside = 0.0, top
    if fits(outside):
        return top
    for _ in range(_BISECTIONS):
        middle = 0.5 * (inside + outside)
        inside, outside = (middle, outside) if fits(middle) else (inside, middle)
    return inside


def _draw_points(axis: Axes, operated: OperatingPoints) -> None:
    axis.scatter(
        operated.speed,
        operated.torque,
        s=1.6,
        color=LIGHT.inside,
        alpha=0.35,
        linewidths=0,
        rasterized=True,
    )
    axis.plot([], [], ".", color=LIGHT.inside, label="recorded")  # in the legend large enough to see


def _finish(axis: Axes, text: str, top: float, drive: JointDrive) -> None:
    axis.axhline(0.0, color=LIGHT.muted, linewidth=0.6)
    axis.axvline(0.0, color=LIGHT.muted, linewidth=0.6)
    axis.set_xlim(-top, top)
    axis.set_ylim(-1.12 * drive.peak_torque, 1.12 * drive.peak_torque)
    axis.set_xlabel("joint speed [rad/s]")
    set_title(axis, text, LIGHT)
