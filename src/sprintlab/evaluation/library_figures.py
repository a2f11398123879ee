"""The actuators of the library side by side."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from sprintlab.core.theme import LIGHT, figure_legend, labelled, set_title, themed_figure
from sprintlab.motors import LibraryMotor, joint_torque, no_load_speed, saturate, torque_limits

_POINTS = 400
_COLORS = ("#0b6bcb", "#c2410c", "#0e9384", "#7a5af8", "#d92d20", "#667085")
_STYLES = ("-", "--", ":")  # six colours in each


def library_figure(actuators: Sequence[LibraryMotor]) -> Figure:
    """Driving torque over speed behind the gear, refined with saturation: absolute, and normalised.

    On the right speed is a share of the no-load speed and torque one of the torque at standstill: the longer
    a curve stays at 1, the later the voltage takes its torque away.
    """
    figure, (absolute, normalised) = themed_figure(LIGHT, (12.5, 5.6), 1, 2)
    for index, actuator in enumerate(actuators):
        speed, torque = driving_envelope(actuator)
        look: dict[str, Any] = {
            "color": _COLORS[index % len(_COLORS)],
            "linestyle": _STYLES[index // len(_COLORS) % len(_STYLES)],
            "linewidth": 1.6,
        }
        absolute.plot(speed, torque, label=actuator.title, **look)
        normalised.plot(speed / speed[-1], torque / torque[0], **look)
    _finish(absolute, "Behind the gear", "joint speed [rad/s]", "joint torque after saturation [N m]")
    _finish(normalised, "Normalised", "speed / no-load speed", "torque / torque at standstill")
    absolute.set(xscale="log", yscale="log")
    absolute.set(xlim=(2.0, None), ylim=(0.5, 2.0 * absolute.dataLim.y1))
    normalised.set(xlim=(0.0, 1.0), ylim=(0.0, 1.05))
    figure_legend(figure, LIGHT, labelled(absolute), columns=3, place="lower")
    return figure


def driving_envelope(actuator: LibraryMotor) -> tuple[NDArray[Any], NDArray[Any]]:
    """Joint speeds from near standstill to no load [rad/s] and the greatest joint torques there [N m]."""
    ratio = float(actuator.gear.ratio)
    top = float(no_load_speed(actuator.motor, actuator.bus_voltage))
    speed = np.linspace(0.0, top, _POINTS)
    _, upper = torque_limits(actuator.motor, speed, actuator.bus_voltage)
    return speed / ratio, joint_torque(actuator.gear, saturate(actuator.motor, upper))


def _finish(axis: Axes, title: str, xlabel: str, ylabel: str) -> None:
    set_title(axis, title, LIGHT)
    axis.set(xlabel=xlabel, ylabel=ylabel)
