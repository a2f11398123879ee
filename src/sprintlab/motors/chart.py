"""What a geared motor can do, put side by side: every model's envelope, its speeds, the d-axis' share.

Everything here is seen from the joint: torque times gear ratio and efficiency, speed divided by the ratio.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from sprintlab.core.array_types import FloatArray
from sprintlab.core.checks import check_positive
from sprintlab.core.errors import InvalidValueError
from sprintlab.motors.arrays import Array
from sprintlab.motors.envelope import MOTOR_MODELS, MotorModel, critical_speed, no_load_speed, torque_limits
from sprintlab.motors.gear import Gear, joint_torque
from sprintlab.motors.parameters import PmsmParameters
from sprintlab.motors.power import copper_loss
from sprintlab.motors.saturation import desaturate, saturate
from sprintlab.motors.voltage import phase_voltage_limit

SATURATED = "refined + saturation"
"""Name of the refined envelope with magnetic saturation: the torque that reaches the joint."""
D_AXIS_SHARES = (0.5, 0.75, 0.9)
"""Shares of the no-load speed at which the cost of the d-axis voltage is told."""

_NEGLIGIBLE = 1e-3  # share of the peak torque below which a motor no longer drives
_FARTHEST = 8.0  # times the no-load speed: how far an end of the driving range is looked for
_SEARCH_POINTS = 4001


@dataclass(frozen=True, kw_only=True)
class JointDrive:
    """One motor, its gear and its bus: what stands behind a joint."""

    motor: PmsmParameters  # One motor, plain numbers
    gear: Gear  # Plain numbers; ratio 1 and efficiency 1 for a motor alone
    bus_voltage: float  # DC bus [V]

    def __post_init__(self) -> None:
        check_positive("bus_voltage", self.bus_voltage, "V")
        for name, value in (("motor.peak_torque", self.motor.peak_torque), ("gear.ratio", self.gear.ratio)):
            if np.ndim(value) > 0:
                raise InvalidValueError(name, value, "must be one number: choose one motor")

    @property
    def no_load_speed(self) -> float:
        """Joint speed at which the back-EMF alone takes the whole voltage [rad/s]."""
        return float(no_load_speed(self.motor, self.bus_voltage)) / float(self.gear.ratio)

    @property
    def peak_torque(self) -> float:
        """Joint torque at the current limit, before saturation [N m]."""
        return float(joint_torque(self.gear, self.motor.peak_torque))


def envelope_names() -> tuple[str, ...]:
    """Every envelope of a chart: the motor models, then ``SATURATED``."""
    return (*MOTOR_MODELS, SATURATED)


def joint_limits(drive: JointDrive, speed: Array, name: str) -> tuple[FloatArray, FloatArray]:
    """Least and greatest joint torque [N m] at joint speeds [rad/s] under one of ``envelope_names()``."""
    model: Any = "refined" if name == SATURATED else name
    motor_speed = np.asarray(speed, dtype=float) * drive.gear.ratio
    limits = torque_limits(drive.motor, motor_speed, drive.bus_voltage, model=model)
    if name == SATURATED:
        limits = (saturate(drive.motor, limits[0]), saturate(drive.motor, limits[1]))
    lower, upper = (np.asarray(joint_torque(drive.gear, limit, speed), dtype=float) for limit in limits)
    return lower, upper


def peak_torque_speed(drive: JointDrive, model: MotorModel) -> float | None:
    """Highest joint speed with the whole peak torque [rad/s]; ``None`` where a model knows none."""
    speed = float(critical_speed(drive.motor, drive.motor.peak_torque, drive.bus_voltage, model=model))
    return speed / float(drive.gear.ratio) if np.isfinite(speed) else None


def end_of_drive(drive: JointDrive, model: MotorModel) -> float | None:
    """Highest joint speed at which a model still drives [rad/s], to 0.1 % of the peak torque.

    ``None`` where the model still drives at eight times the no-load speed.
    """
    speed = np.linspace(0.0, _FARTHEST * drive.no_load_speed, _SEARCH_POINTS)
    _, upper = joint_limits(drive, speed, model)
    driving = upper > _NEGLIGIBLE * drive.peak_torque
    if driving[-1]:
        return None
    return float(speed[np.flatnonzero(driving)[-1]]) if driving.any() else 0.0


def d_axis_cost(drive: JointDrive, share: float) -> dict[str, float]:
    """What the d-axis voltage takes from the driving torque at ``share`` of the no-load speed.

    At the refined limit the current ``i_q`` makes ``v_d = -omega_e L i_q``.

    Returns:
        ``share`` [-], joint ``speed`` [rad/s], greatest joint torques without v_d (``simplified-dc``) and
        with it [N m], ``voltage_share = |v_d| / V`` there [-], and the share ``lost`` of the torque [-].
    """
    motor, speed = drive.motor, share * drive.no_load_speed
    without = float(joint_limits(drive, speed, "simplified-dc")[1])
    _, upper = torque_limits(motor, speed * drive.gear.ratio, drive.bus_voltage)
    torque = float(joint_torque(drive.gear, upper))
    current = float(upper) / float(motor.torque_constant)
    electrical_speed = float(motor.pole_pairs) * speed * float(drive.gear.ratio)
    voltage = abs(electrical_speed * float(motor.q_axis_inductance) * current)
    return {
        "share": share,
        "speed": speed,
        "torque_without": without,
        "torque": torque,
        "voltage_share": voltage / float(phase_voltage_limit(drive.bus_voltage)),
        "lost": 1.0 - torque / without if without > 0 else 0.0,
    }


def peak_power(drive: JointDrive, name: str) -> dict[str, float]:
    """Where a joint drives with most ``power`` [W] under one envelope: ``speed`` [rad/s], ``torque`` [N m].

    Looked for as far as the model drives, with flux weakening beyond the no-load speed; ``square``, which
    always drives, is looked at up to the no-load speed.
    """
    model: Any = "refined" if name == SATURATED else name
    end = drive.no_load_speed if name == "square" else end_of_drive(drive, model)
    farthest = _FARTHEST * drive.no_load_speed if end is None else end
    speed = np.linspace(0.0, farthest, _SEARCH_POINTS)
    _, upper = joint_limits(drive, speed, name)
    best = int(np.argmax(upper * speed))
    return {
        "power": float(upper[best] * speed[best]),
        "speed": float(speed[best]),
        "torque": float(upper[best]),
    }


def joint_copper_loss(drive: JointDrive, delivered_torque: Array) -> FloatArray:
    """Heat in the windings [W] while the joint gets a torque [N m], saturation included, i_d = 0."""
    shaft = np.asarray(delivered_torque, dtype=float) / float(joint_torque(drive.gear, 1.0))
    return np.asarray(copper_loss(drive.motor, desaturate(drive.motor, shaft)), dtype=float)
