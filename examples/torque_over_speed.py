"""What examples of other simulators share: torque over speed, asked and delivered, on the motors' law."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from sprintlab.core.theme import LIGHT, axis_legend, save_figure, set_title, style_axis, themed_figure
from sprintlab.motors import Gear, PmsmParameters, drive_torque, no_load_speed
from sprintlab.robots import RobotDescription

FloatArray = NDArray[np.float64]
PARAMETERS = [item.name for item in fields(PmsmParameters)]


class Drives(NamedTuple):
    """Motors behind their gears, arrays ``(joints,)``, on one bus."""

    motor: PmsmParameters
    gear: Gear
    bus_voltage: float
    """[V]"""

    def single(self, joint: int) -> Drives:
        """Those of one joint, plain numbers."""
        values = {name: np.asarray(getattr(self.motor, name))[joint].item() for name in PARAMETERS}
        gear = Gear(ratio=float(self.gear.ratio[joint]), efficiency=float(self.gear.efficiency[joint]))
        return Drives(PmsmParameters(**values), gear, self.bus_voltage)

    def limits(self, speed: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Least and greatest joint torque [N m] at joint speeds [rad/s] ``(..., joints)``."""
        most = 10.0 * self.motor.peak_torque * self.gear.ratio
        lower, upper = (
            drive_torque(self.motor, self.gear, sign * most, speed, self.bus_voltage).torque
            for sign in (-1.0, 1.0)
        )
        return lower, upper

    def no_load_speed(self) -> FloatArray:
        """Joint speed [rad/s] ``(joints,)`` at which no torque is left."""
        return no_load_speed(self.motor, self.bus_voltage) / self.gear.ratio


class Motion(Protocol):
    """A motion of ``n`` steps."""

    @property
    def speed(self) -> FloatArray:
        """Velocities of the joints [rad/s] ``(n, joints)``."""
        ...

    @property
    def asked(self) -> FloatArray:
        """Torque that the controller wants [N m] ``(n, joints)``."""
        ...

    @property
    def delivered(self) -> FloatArray:
        """Torque on the joints [N m] ``(n, joints)``."""
        ...


class Walk(NamedTuple):
    """``n`` steps of a walk, joints in the model's order."""

    held: float
    """Mean forward speed over the second half [m/s]."""
    lowest: float
    """Least height of the trunk [m]."""
    speed: FloatArray
    """Velocities of the joints [rad/s] ``(n, joints)``."""
    asked: FloatArray
    """Torque of the PD loop [N m] ``(n, joints)``."""
    delivered: FloatArray
    """On the joints [N m] ``(n, joints)``."""


def walked(
    trunk: FloatArray, speed: FloatArray, asked: FloatArray, delivered: FloatArray, timestep: float
) -> Walk:
    """A walk from its samples: the trunk's positions [m] ``(n, 3)``, the joints' speeds and torques."""
    half = len(trunk) // 2
    held = (trunk[-1, 0] - trunk[half, 0]) / (timestep * (len(trunk) - 1 - half))
    return Walk(float(held), float(trunk[:, 2].min()), speed, asked, delivered)


def table_drives(robot: RobotDescription, joints: Sequence[int]) -> Drives:
    """The table's motors and gears of these joints, in this order."""
    places = np.asarray(joints)
    count = len(robot.joint_names)
    values = {name: np.broadcast_to(getattr(robot.motors, name), count)[places] for name in PARAMETERS}
    gear = Gear(ratio=robot.gear.ratio[places], efficiency=robot.gear.efficiency[places])
    return Drives(PmsmParameters(**values), gear, robot.bus_voltage)


def impossible_share(own: Motion, drives: Drives) -> float:
    """Share of a motion's driving work that these motors could not have done at the same speeds [-]."""
    possible = np.clip(own.delivered, *drives.limits(own.speed))
    done = np.maximum(own.delivered * own.speed, 0.0)
    return float(1.0 - np.clip(possible * own.speed, 0.0, done).sum() / done.sum())


def draw(
    path: Path, rows: Mapping[str, Sequence[int]], columns: Mapping[str, Motion], drives: Drives
) -> None:
    """Torque over speed, asked and delivered: a row for each kind of joint, a column for each motion."""
    size = (4.5 * len(columns), 3.2 * len(rows))
    figure, axes = themed_figure(LIGHT, size, len(rows), len(columns), sharex=True)
    for index, axis in enumerate(axes):
        row, column = divmod(index, len(columns))
        part, name = list(rows)[row], list(columns)[column]
        _draw_cloud(axis, columns[name], rows[part], drives)
        set_title(axis, f"{part}, {name}", LIGHT)
        axis.set_xlabel("joint speed [rad/s]" if row == len(rows) - 1 else "")
        axis.set_ylabel("" if column else "joint torque [N m]")
    axis_legend(axes[(len(rows) - 1) * len(columns)], LIGHT, loc="lower right", markerscale=4.0)
    save_figure(path, figure, dpi=110 if len(columns) < 3 else 80)


def _draw_cloud(axis: Any, found: Motion, joints: Sequence[int], drives: Drives) -> None:
    """The operating points of some joints of one kind on what their motor can give."""
    style_axis(axis, LIGHT)
    envelope = _envelope(drives.single(joints[0]))
    axis.fill_between(*envelope, color=LIGHT.envelope, lw=0.0, label="what the motor can give")
    kept = slice(None, None, -(-len(found.speed) // 1500))
    for values, color, label in (
        (found.asked, LIGHT.muted, "asked by the PD loop"),
        (found.delivered, LIGHT.on_limit, "delivered"),
    ):
        speed, torque = found.speed[kept, joints].ravel(), values[kept, joints].ravel()
        axis.plot(speed, torque, ".", ms=2.5, color=color, label=label)
    axis.set_ylim(1.6 * envelope[1].min(), 1.6 * envelope[2].max())


def _envelope(one: Drives) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Speeds [rad/s], least and greatest torque [N m] of one joint."""
    top = 1.3 * float(one.no_load_speed())
    speeds = np.linspace(-top, top, 201)
    return speeds, *one.limits(speeds)
