"""The numbers and curves beside the robot: speed and command, motors on their envelopes, bus power."""

from __future__ import annotations

from collections import deque
from typing import Any

import numpy as np
import viser
from numpy.typing import NDArray

from sprintlab.robots import RobotDescription
from sprintlab.viewer.envelope_plot import EnvelopePlot
from sprintlab.viewer.live import Glimpse, Knobs

PLOT_SECONDS = 10.0
"""Simulated time that the curves show [s]."""

_STEPS = (1.0, 2.0, 3.0, 4.0, 6.0, 8.0, 10.0, 12.0, 15.0, 20.0, 30.0, 50.0, 100.0)
_HEIGHT = 150
_STYLE = """<style>
.envelope { width: 100%; display: block; margin: 2px 0; }
.envelope .axis { stroke: #868e96; stroke-width: .7; opacity: .6; fill: none; }
.envelope .real { fill: #228be6; fill-opacity: .16; stroke: #228be6; stroke-width: 1; }
.envelope .used { fill: none; stroke: #868e96; stroke-width: 1.2; stroke-dasharray: 4 3; }
.envelope .tail { fill: none; stroke-width: 1.2; opacity: .45; }
.envelope text { font: 9px system-ui, sans-serif; fill: #868e96; }
.envelope .name { font-size: 12px; }
.sprintlab { padding: 2px 14px; font: 12px system-ui, sans-serif; font-variant-numeric: tabular-nums; }
.sprintlab b { font-size: 20px; } .sprintlab td { padding-right: 16px; white-space: nowrap; }
.sprintlab .fell { color: #e03131; font-weight: 600; }
</style>"""


class Plots:
    """A panel of its own at the left edge of the page.

    Args:
        server: the page.
        robot: whose motors are drawn.
    """

    def __init__(self, server: viser.ViserServer, robot: RobotDescription) -> None:
        self._envelope = EnvelopePlot(robot)
        self._curves: deque[tuple[float, float, float, float]] = deque()
        self._last: Glimpse | None = None
        gui = server.gui
        self.panel = gui.add_panel()
        with self.panel.add_tab("Speed, motors, power"):
            self._status = gui.add_html(_STYLE)
            with gui.add_folder("Speed and command (m/s)"):
                curves = _series(("speed", "#228be6"), ("command", "#e8590c"))
                self._speed = _Curves(gui, curves)
            with gui.add_folder("Motors on their envelopes (motor side)"):
                self._envelopes = gui.add_html("")
            with gui.add_folder("Bus power (kW)"):
                self._power = _Curves(gui, _series(("power", "#12b886")))
        self.panel.dock_left()
        self.panel.set_width(380)

    def add(self, glimpse: Glimpse) -> None:
        """One more point of the curves, which forget what is older than ``PLOT_SECONDS``."""
        self._curves.append((glimpse.time, glimpse.speed, glimpse.command[0], glimpse.bus_power / 1e3))
        while self._curves[0][0] < glimpse.time - PLOT_SECONDS:
            self._curves.popleft()
        if len(glimpse.joint_speed):
            self._last = glimpse

    def draw(self, glimpse: Glimpse, knobs: Knobs) -> None:
        """Send numbers, curves and motors to the page."""
        self._status.content = _STYLE + status_text(glimpse)
        if len(self._curves) < 2 or self._last is None:
            return
        moment, speed, command, power = np.array(self._curves).T
        self._speed.show(moment, speed, command)
        self._power.show(moment, power)
        drawing = self._envelope.draw(
            self._last.joint_speed, self._last.motor_torque, knobs.motor_model, knobs.bus_voltage
        )
        self._envelopes.content = f'<div class="sprintlab">{drawing}</div>'


class _Curves:
    """One plot over time, whose range of values changes in steps, so that it does not jump."""

    def __init__(self, gui: Any, series: Any) -> None:
        empty = np.zeros(2)
        self._range = value_range(empty)
        data = tuple(empty for _ in series)
        self._plot = gui.add_uplot(data, series, scales=self._scales(), height=_HEIGHT)

    def show(self, moment: NDArray[Any], *values: NDArray[Any]) -> None:
        """Draw values over the time [s]."""
        wanted = value_range(np.concatenate(values))
        if wanted != self._range:
            self._range = wanted
            self._plot.scales = self._scales()
        self._plot.data = (moment, *values)

    def _scales(self) -> Any:
        return {"x": {"time": False, "auto": True}, "y": {"auto": False, "range": self._range}}


def value_range(values: NDArray[Any]) -> tuple[float, float]:
    """Round limits of a plot that hold all values; zero is always in, and small values stay small."""
    low, high = float(np.min(values)), float(np.max(values))
    below = 0.0 if low >= 0.0 else -0.5 if low > -0.5 else -_step_above(-low)
    return below, _step_above(max(high, 0.0))


def _step_above(value: float) -> float:
    return next((step for step in _STEPS if step >= value), value)


def _series(*curves: tuple[str, str]) -> Any:
    """Looks of the curves of a plot, the time first."""
    return ({"label": "s"}, *({"label": name, "stroke": color, "width": 2} for name, color in curves))


def status_text(glimpse: Glimpse) -> str:
    """Speed, command, power and way; ``data-`` attributes for programs that read the page."""
    state = f'<span class="fell">fell: {glimpse.fall_reason}</span>' if glimpse.fall_reason else "running"
    cells = (
        (_number(glimpse.speed, 1), "m/s"),
        (_number(glimpse.command[0], 1), "m/s asked"),
        (_number(glimpse.bus_power / 1e3, 1), "kW"),
        (_number(glimpse.distance, 0), "m"),
    )
    row = "".join(f"<td><b>{value}</b> {unit}</td>" for value, unit in cells)
    falls = "1 fall" if glimpse.falls == 1 else f"{glimpse.falls} falls"
    return (
        f'<div class="sprintlab" id="status" data-speed="{glimpse.speed:.3f}" data-time="{glimpse.time:.3f}" '
        f'data-distance="{glimpse.distance:.3f}" data-command="{glimpse.command[0]:.3f}" '
        f'data-yaw-rate="{glimpse.command[2]:.3f}" data-falls="{glimpse.falls}"><table><tr>{row}</tr></table>'
        f"{state}, {falls}, {glimpse.time:.1f} s</div>"
    )


def _number(value: float, digits: int) -> str:
    """A number without the minus sign of a zero."""
    return f"{round(value, digits) + 0.0:.{digits}f}"
