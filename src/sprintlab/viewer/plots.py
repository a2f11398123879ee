"""The numbers and curves beside the robot: speed and command, motors on their envelopes, bus power."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from typing import Any

import numpy as np
import viser
from numpy.typing import NDArray

from sprintlab.core.text import number
from sprintlab.robots import RobotDescription
from sprintlab.viewer.envelope_plot import EnvelopePlot, legend
from sprintlab.viewer.live import Knobs, Snapshot

PLOT_SECONDS = 10.0
"""Simulated time that the curves show [s]."""

SPEED_WINDOW = 0.4
"""Time over which the shown speed is averaged, a few strides [s]."""

_STEPS = (1.0, 2.0, 3.0, 4.0, 6.0, 8.0, 10.0, 12.0, 15.0, 20.0, 30.0, 50.0, 100.0)
_STYLE = """<style>
.envelope { width: 100%; display: block; margin: 2px 0; }
.envelope .axis { stroke: #868e96; stroke-width: .7; opacity: .6; fill: none; }
.envelope .real { fill: #228be6; fill-opacity: .16; stroke: #228be6; stroke-width: 1; }
.envelope .used { fill: none; stroke: #868e96; stroke-width: 1.2; stroke-dasharray: 4 3; }
.envelope .tail { fill: none; stroke-width: 1.2; opacity: .45; }
.envelope text { font: 9px system-ui, sans-serif; fill: #868e96; }
.envelope .name { font-size: 12px; }
.sprintlab { padding: 2px 14px; font: 12px system-ui, sans-serif; font-variant-numeric: tabular-nums; }
.sprintlab b { font-size: 18px; } .sprintlab td { padding-right: 10px; white-space: nowrap; }
.sprintlab tr { display: flex; flex-wrap: wrap; }
.sprintlab .fell { color: #e03131; font-weight: 600; }
</style>"""


class Plots:
    """A status at the head of the main panel, and a panel of its own at the left edge of the page.

    The main panel must be empty before.
    """

    def __init__(self, server: viser.ViserServer, robot: RobotDescription) -> None:
        self._envelope = EnvelopePlot(robot)
        self._curves: deque[tuple[float, float, float, float]] = deque()
        self._recent: deque[tuple[float, float]] = deque()
        self._last: Snapshot | None = None
        gui = server.gui
        self._status = gui.add_html(_STYLE)
        panel = gui.add_panel()
        with panel.add_tab("Speed, motors, power"):
            with gui.add_folder("Speed and command (m/s)"):
                self._speed = _Curves(gui, {"speed": "#228be6", "command": "#e8590c"})
            with gui.add_folder("Motors on their envelopes (motor side)"):
                self._envelopes = gui.add_html("")
            with gui.add_folder("Bus power (kW)"):
                self._power = _Curves(gui, {"power": "#12b886"})
        panel.dock_left()
        panel.set_width(350)

    def add(self, snapshot: Snapshot) -> None:
        """One more point of the curves, which forget what is older than ``PLOT_SECONDS``."""
        self._recent.append((snapshot.time, snapshot.speed))
        while self._recent[0][0] < snapshot.time - SPEED_WINDOW:
            self._recent.popleft()
        power = snapshot.bus_power / 1e3
        self._curves.append((snapshot.time, self._mean_speed(snapshot), snapshot.command[0], power))
        while self._curves[0][0] < snapshot.time - PLOT_SECONDS:
            self._curves.popleft()
        if len(snapshot.joint_speed):
            self._last = snapshot

    def _mean_speed(self, snapshot: Snapshot) -> float:
        """The trunk swings with each stride, and a swing is not a speed."""
        recent = [speed for _, speed in self._recent]
        return sum(recent) / len(recent) if recent else snapshot.speed

    def draw(self, snapshot: Snapshot, knobs: Knobs, pace: float) -> None:
        """Send numbers, curves and motors to the page; ``pace`` is in simulated seconds a second."""
        self._status.content = _STYLE + status_text(snapshot, self._mean_speed(snapshot), pace)
        if len(self._curves) < 2 or self._last is None:
            return
        moment, speed, command, power = np.array(self._curves).T
        self._speed.show(moment, speed, command)
        self._power.show(moment, power)
        points = self._last.joint_speed, self._last.motor_torque
        drawing = self._envelope.draw(*points, knobs.motor_model, knobs.bus_voltage)
        self._envelopes.content = f'<div class="sprintlab">{drawing}</div>'


class _Curves:
    """One plot over time, with curves in colours by name; its range of values changes in steps.

    The range is held by an unseen curve: a plot whose scales are replaced while it runs stands still.
    """

    def __init__(self, gui: Any, colors: Mapping[str, str]) -> None:
        looks = [{"label": name, "stroke": color, "width": 2} for name, color in colors.items()]
        if len(colors) > 1:
            gui.add_html(f'<div class="sprintlab">{legend(colors)}</div>')
        self._plot = gui.add_uplot(
            (np.zeros(2),) * (len(looks) + 2),
            ({"label": "s"}, *looks, {"label": "", "stroke": "transparent", "width": 0}),
            scales={"x": {"time": False, "auto": True}, "y": {"auto": True}},
            legend={"show": False},
            height=120,
        )

    def show(self, moment: NDArray[Any], *values: NDArray[Any]) -> None:
        """Draw values over the time [s]."""
        low, high = value_range(np.concatenate(values))
        holder = np.full(len(moment), high)
        holder[0] = low
        self._plot.data = (moment, *values, holder)


def value_range(values: NDArray[Any]) -> tuple[float, float]:
    """Round limits of a plot that hold all values; zero is always in, and small values stay small."""
    low, high = float(np.min(values)), float(np.max(values))
    below = 0.0 if low >= 0.0 else -0.5 if low > -0.5 else -_step_above(-low)
    return below, _step_above(max(high, 0.0))


def _step_above(value: float) -> float:
    return next((step for step in _STEPS if step >= value), value)


def status_text(snapshot: Snapshot, speed: float, pace: float) -> str:
    """Speed, command, power, distance and pace; ``data-`` attributes for programs that read the page."""
    state = f'<span class="fell">fell: {snapshot.fall_reason}</span>' if snapshot.fall_reason else "running"
    cells = (
        (speed, 1, "m/s"),
        (snapshot.command[0], 1, "asked"),
        (snapshot.bus_power / 1e3, 1, "kW"),
        (snapshot.distance, 0, "m"),
    )
    row = "".join(f"<td><b>{number(value, digits)}</b> {unit}</td>" for value, digits, unit in cells)
    falls = "1 fall" if snapshot.falls == 1 else f"{snapshot.falls} falls"
    numbers = {
        "speed": speed, "time": snapshot.time, "distance": snapshot.distance, "command": snapshot.command[0],
        "yaw-rate": snapshot.command[2], "falls": snapshot.falls, "pace": pace,
    }  # fmt: skip
    data = " ".join(f'data-{name}="{value:.3f}"' for name, value in numbers.items())
    return (
        f'<div class="sprintlab" id="status" {data}><table><tr>{row}</tr></table>'
        f"{state}, {falls}, {snapshot.time:.1f} s, {pace:.2f} x real time</div>"
    )
