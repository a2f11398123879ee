"""Where every motor stands on its torque-speed envelope, as an SVG drawing that is cheap to redraw.

One panel a kind of joint: the filled area is what the refined model allows at the present bus voltage, the
dashed line what the model in use allows where that is another, and each leg is a dot with a short tail.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sprintlab.core.array_types import FloatArray
from sprintlab.motors import MotorModel, PreparedDrive, no_load_speed
from sprintlab.robots import RobotDescription, joint_kind

LEG_COLORS = ("#228be6", "#e8590c", "#12b886", "#be4bdb")
_WIDTH, _HEIGHT, _MARGIN = 320.0, 100.0, 6.0
_SPEEDS = 61
_BEYOND = 1.15  # the panel reaches this far past no-load speed and peak torque


@dataclass(frozen=True, kw_only=True)
class _Panel:
    """One kind of joint: its columns in ``(joints,)`` arrays and the scales of its axes."""

    name: str
    joints: NDArray[np.int64]
    top_speed: float
    top_torque: float

    def points(self, speed: FloatArray, torque: FloatArray) -> str:
        """Motor speeds [rad/s] and torques [N m] as ``x,y x,y ...`` in the drawing."""
        x = _MARGIN + (_WIDTH - 2 * _MARGIN) * np.clip(0.5 + 0.5 * speed / self.top_speed, 0.0, 1.0)
        y = _MARGIN + (_HEIGHT - 2 * _MARGIN) * np.clip(0.5 - 0.5 * torque / self.top_torque, 0.0, 1.0)
        return " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(x, y, strict=True))


class EnvelopePlot:
    """The drawing for one robot.

    Args:
        robot: its joints are grouped by what follows the leg's name.
    """

    def __init__(self, robot: RobotDescription) -> None:
        self._robot = robot
        self._ratio = np.broadcast_to(np.asarray(robot.gear.ratio, dtype=float), (len(robot.joint_names),))
        kinds = dict.fromkeys(map(joint_kind, robot.joint_names))
        top_speed = np.asarray(no_load_speed(robot.motors, robot.bus_voltage)) * _BEYOND
        top_torque = np.broadcast_to(np.asarray(robot.motors.peak_torque) * _BEYOND, top_speed.shape)
        self._panels = [
            _Panel(
                name=kind,
                joints=joints,
                top_speed=float(top_speed[joints[0]]),
                top_torque=float(top_torque[joints[0]]),
            )
            for kind, joints in ((kind, self._joints_of(kind)) for kind in kinds)
        ]
        self._backgrounds: dict[tuple[MotorModel, float], list[str]] = {}

    def _joints_of(self, kind: str) -> NDArray[np.int64]:
        names = self._robot.joint_names
        return np.array([index for index, name in enumerate(names) if joint_kind(name) == kind])

    def draw(
        self, joint_speed: FloatArray, motor_torque: FloatArray, model: MotorModel, bus_voltage: float
    ) -> str:
        """The SVG elements.

        Args:
            joint_speed: ``(n, joints)`` joint side [rad/s], oldest first.
            motor_torque: ``(n, joints)`` motor side [N m].
            model: motor law in use.
            bus_voltage: [V].
        """
        backgrounds = self._background(model, bus_voltage)
        speed = joint_speed * self._ratio
        drawings = [
            _svg(panel.name, background + self._legs(panel, speed, motor_torque))
            for panel, background in zip(self._panels, backgrounds, strict=True)
        ]
        return "".join(drawings) + legend(dict(zip(self._robot.leg_names, LEG_COLORS, strict=False)))

    def _background(self, model: MotorModel, bus_voltage: float) -> list[str]:
        """Axes and envelopes of every panel; drawn once for a law and a voltage."""
        key = model, bus_voltage
        if key not in self._backgrounds:
            self._backgrounds[key] = [self._envelopes(panel, model, bus_voltage) for panel in self._panels]
        return self._backgrounds[key]

    def _envelopes(self, panel: _Panel, model: MotorModel, bus_voltage: float) -> str:
        zero = np.zeros(2)
        ends = np.array([-1.0, 1.0])
        axes = (
            _line(panel.points(ends * panel.top_speed, zero), "axis"),
            _line(panel.points(zero, ends * panel.top_torque), "axis"),
        )
        labels = _labels(panel)
        area = f'<polygon class="real" points="{self._outline(panel, "refined", bus_voltage)}"/>'
        used = f'<polygon class="used" points="{self._outline(panel, model, bus_voltage)}"/>'
        return "".join(axes) + area + ("" if model == "refined" else used) + labels

    def _outline(self, panel: _Panel, model: MotorModel, bus_voltage: float) -> str:
        drive, joint = (
            PreparedDrive(self._robot.motors, self._robot.gear, bus_voltage, model),
            panel.joints[0],
        )
        speed = np.linspace(-panel.top_speed, panel.top_speed, _SPEEDS)
        limits = [drive.limits(np.full(len(self._ratio), value) / self._ratio) for value in speed]
        lower, upper = (np.array([pair[side][joint] for pair in limits]) for side in (0, 1))
        return panel.points(np.append(speed, speed[::-1]), np.append(upper, lower[::-1]))

    def _legs(self, panel: _Panel, speed: FloatArray, torque: FloatArray) -> str:
        if not len(speed):
            return ""
        marks = []
        for joint, color in zip(panel.joints, LEG_COLORS, strict=False):
            points = panel.points(speed[:, joint], torque[:, joint])
            x, y = points.rsplit(" ", 1)[-1].split(",")
            marks.append(f'<polyline class="tail" stroke="{color}" points="{points}"/>')
            marks.append(f'<circle cx="{x}" cy="{y}" r="4" fill="{color}"/>')
        return "".join(marks)


def legend(colors: Mapping[str, str]) -> str:
    """A dot and a name in each colour, as HTML."""
    return " ".join(f'<span style="color:{color}">&#9679; {name}</span>' for name, color in colors.items())


def _line(points: str, name: str) -> str:
    return f'<polyline class="{name}" points="{points}"/>'


def _labels(panel: _Panel) -> str:
    """No-load speed and peak torque on the axes, at the bus voltage that the robot is made for."""
    speed, torque = panel.top_speed / _BEYOND, panel.top_torque / _BEYOND
    x, middle = panel.points(np.array([speed]), np.zeros(1)).split(",")
    y = panel.points(np.zeros(1), np.array([torque])).split(",")[1]
    return (
        f'<text x="{x}" y="{float(middle) - 3:g}" text-anchor="end">{speed:.0f} rad/s</text>'
        f'<text x="{0.5 * _WIDTH + 3:g}" y="{float(y) + 10:g}">{torque:.3g} N m</text>'
    )


def _svg(name: str, body: str) -> str:
    label = f'<text x="{_MARGIN}" y="{_HEIGHT - 9:g}" class="name">{name}</text>'
    return f'<svg class="envelope" viewBox="0 0 {_WIDTH:g} {_HEIGHT:g}">{body}{label}</svg>'
