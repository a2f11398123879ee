"""Where every motor stands on its torque-speed envelope, as an SVG drawing that is cheap to redraw.

One panel a kind of joint: the filled area is what the refined model allows at the present bus voltage, the
dashed line what the model in use allows where that is another, and each leg is a dot with a short tail.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache

import numpy as np

from sprintlab.core.array_types import FloatArray
from sprintlab.motors import MotorModel, PreparedDrive, no_load_speed
from sprintlab.robots import RobotDescription, joint_kind

LEG_COLORS = ("#228be6", "#e8590c", "#12b886", "#be4bdb")
_WIDTH, _HEIGHT, _MARGIN = 320.0, 100.0, 6.0
_SPEEDS = 61
_BEYOND = 1.15  # the panel reaches this far past no-load speed and peak torque


class EnvelopePlot:
    """The drawing for one robot, whose joints are grouped by what follows the leg's name."""

    def __init__(self, robot: RobotDescription) -> None:
        self._robot = robot
        self._ratio = np.broadcast_to(np.asarray(robot.gear.ratio, dtype=float), (len(robot.joint_names),))
        kinds = list(map(joint_kind, robot.joint_names))
        self._kinds = {kind: [i for i, one in enumerate(kinds) if one == kind] for kind in kinds}
        self._top_speed = np.asarray(no_load_speed(robot.motors, robot.bus_voltage)) * _BEYOND
        peak = np.asarray(robot.motors.peak_torque) * _BEYOND
        self._top_torque = np.broadcast_to(peak, self._top_speed.shape)
        self._background = lru_cache(maxsize=64)(self._draw_background)

    def draw(
        self, joint_speed: FloatArray, motor_torque: FloatArray, model: MotorModel, bus_voltage: float
    ) -> str:
        """The SVG elements.

        Speeds on the joint side [rad/s] and torques on the motor side [N m] are ``(n, joints)``, oldest
        first; the motor law is that in use, the bus voltage in [V].
        """
        speed, drawings = joint_speed * self._ratio, []
        for kind, joints in self._kinds.items():
            marks = []
            for joint, color in zip(joints if len(speed) else (), LEG_COLORS, strict=False):
                points = self._points(joint, speed[:, joint], motor_torque[:, joint])
                x, y = points.rsplit(" ", 1)[-1].split(",")
                marks.append(f'<polyline class="tail" stroke="{color}" points="{points}"/>')
                marks.append(f'<circle cx="{x}" cy="{y}" r="4" fill="{color}"/>')
            name = f'<text x="{_MARGIN}" y="{_HEIGHT - 9:g}" class="name">{kind}</text>'
            body = self._background(joints[0], model, bus_voltage) + "".join(marks) + name
            drawings.append(f'<svg class="envelope" viewBox="0 0 {_WIDTH:g} {_HEIGHT:g}">{body}</svg>')
        return "".join(drawings) + legend(dict(zip(self._robot.leg_names, LEG_COLORS, strict=False)))

    def _points(self, joint: int, speed: FloatArray, torque: FloatArray) -> str:
        """Motor speeds [rad/s] and torques [N m] as ``x,y x,y ...`` in the panel of a joint."""
        right, up = speed / self._top_speed[joint], torque / self._top_torque[joint]
        x = _MARGIN + (_WIDTH - 2 * _MARGIN) * np.clip(0.5 + 0.5 * right, 0.0, 1.0)
        y = _MARGIN + (_HEIGHT - 2 * _MARGIN) * np.clip(0.5 - 0.5 * up, 0.0, 1.0)
        return " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(x, y, strict=True))

    def _draw_background(self, joint: int, model: MotorModel, bus_voltage: float) -> str:
        """Axes, envelopes, no-load speed and peak torque at the bus voltage that the robot is made for."""
        zero, ends = np.zeros(2), np.array([-1.0, 1.0])
        top_speed, top_torque = float(self._top_speed[joint]), float(self._top_torque[joint])
        axes = (
            self._points(joint, ends * top_speed, zero),
            self._points(joint, zero, ends * top_torque),
        )
        lines = "".join(f'<polyline class="axis" points="{points}"/>' for points in axes)
        laws: dict[str, MotorModel] = {"real": "refined"}
        laws |= {} if model == "refined" else {"used": model}
        for style, law in laws.items():
            lines += f'<polygon class="{style}" points="{self._outline(joint, law, bus_voltage)}"/>'
        speed, torque = np.array([0.0, top_speed / _BEYOND]), np.array([top_torque / _BEYOND, 0.0])
        (_, y), (x, middle) = (pair.split(",") for pair in self._points(joint, speed, torque).split(" "))
        return (
            f'{lines}<text x="{x}" y="{float(middle) - 3:g}" text-anchor="end">{speed[1]:.0f} rad/s</text>'
            f'<text x="{0.5 * _WIDTH + 3:g}" y="{float(y) + 10:g}">{torque[0]:.3g} N m</text>'
        )

    def _outline(self, joint: int, model: MotorModel, bus_voltage: float) -> str:
        drive = PreparedDrive(self._robot.motors, self._robot.gear, bus_voltage, model)
        speed = np.linspace(-self._top_speed[joint], self._top_speed[joint], _SPEEDS)
        limits = [drive.limits(value / self._ratio) for value in speed]
        lower, upper = (np.array([pair[side][joint] for pair in limits]) for side in (0, 1))
        return self._points(joint, np.append(speed, speed[::-1]), np.append(upper, lower[::-1]))


def legend(colors: Mapping[str, str]) -> str:
    """A dot and a name in each colour, as HTML."""
    return " ".join(f'<span style="color:{color}">&#9679; {name}</span>' for name, color in colors.items())
