"""Peak and continuous current of a drive (I²t): how long an overload may last before the current is cut back.

The drive keeps a first-order image of the windings' heat, the level ``U`` (thermal image of IEC 60255-149):

    dU/dt = ((i_d^2 + i_q^2) / i_c^2 - U) / T ,    U <= 1 ,

with the continuous current ``i_c`` and a time constant ``T``. While ``U`` is below 1 the peak current may
flow; the current is cut back, at last to ``i_c``, so that ``U`` never passes 1. A constant current ``k i_c``
from cold reaches 1 after ``T ln(k^2 / (k^2 - 1))``: so a peak duration, as data sheets print it, gives ``T``.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import cast

from sprintlab.core.checks import check_positive, check_range
from sprintlab.core.errors import InvalidValueError
from sprintlab.motors.arrays import Array, as_arrays
from sprintlab.motors.drive import DriveOutput, drive_torque
from sprintlab.motors.envelope import MotorModel
from sprintlab.motors.gear import Gear
from sprintlab.motors.parameters import MotorValues, PmsmParameters


@dataclass(frozen=True, kw_only=True)
class I2tLimit:
    """How a drive cuts overloads back; each field a number, or an array with one motor an element.

    The peak current is the motor's: ``peak_torque / torque_constant``.

    Raises:
        InvalidValueError: a value is not positive, or not exactly one of the two durations is given.
    """

    continuous_current: Array
    """Amplitude i_c of the phase current that may flow for ever, ``sqrt(i_d^2 + i_q^2)`` [A]."""
    peak_duration: Array | None = None
    """For which the peak current may flow from cold [s]."""
    time_constant: Array | None = None
    """T of the level, e.g. a data sheet's thermal time constant of the winding [s]."""

    def __post_init__(self) -> None:
        """Refuse what cannot be."""
        check_range("i2t.continuous_current", self.continuous_current, 1e-3, 1e5, "A")
        given = {name: getattr(self, name) for name in ("peak_duration", "time_constant")}
        given = {name: value for name, value in given.items() if value is not None}
        if len(given) != 1:
            raise InvalidValueError("i2t", sorted(given), "give peak_duration or time_constant, one of them")
        for name, value in given.items():
            check_range(f"i2t.{name}", value, 1e-3, 1e6, "s")


def i2t_time_constant(limit: I2tLimit, motor: PmsmParameters) -> Array:
    """Time constant T of the level [s], in the shape of limit and motor broadcast.

    Raises:
        InvalidValueError: the continuous current is not below the motor's peak current, or the fields of the
            limit are for another number of motors.
    """
    duration = limit.time_constant if limit.peak_duration is None else limit.peak_duration
    xp, (continuous, duration, peak, constant) = as_arrays(
        limit.continuous_current, duration, motor.peak_torque, motor.torque_constant
    )
    try:
        share = (continuous * constant / peak) ** 2
        duration = duration + xp.zeros_like(share)
    except (ValueError, RuntimeError) as error:
        raise InvalidValueError("i2t", limit, "give one number, or one for each motor") from error
    if not bool((share < 1.0).all()):
        allowed = f"must lie below the peak current of {float((peak / constant).min()):.4g} A"
        raise InvalidValueError("i2t.continuous_current", limit.continuous_current, allowed)
    return duration if limit.peak_duration is None else -duration / xp.log(1.0 - share)


def i2t_decay(limit: I2tLimit, motor: PmsmParameters, duration: float) -> Array:
    """Share of the level that is left after ``duration`` [s] without current [-]; as ``i2t_time_constant``.

    Raises:
        InvalidValueError: see ``i2t_time_constant``; or the duration is not positive.
    """
    check_positive("duration", duration, "s")
    xp, (time_constant,) = as_arrays(i2t_time_constant(limit, motor))
    return xp.exp(-duration / time_constant)


def i2t_current(continuous_current: Array, level: Array, decay: Array) -> Array:
    """Greatest constant current after which the level is at most 1 [A]; far above any peak while it is low.

    Args:
        continuous_current: i_c [A].
        level: U now [-], in [0, 1].
        decay: of the time for which the current flows, ``i2t_decay`` [-].
    """
    xp, (continuous, level, decay) = as_arrays(continuous_current, level, decay)
    room = (1.0 - level * decay) / (1.0 - decay)
    return continuous * xp.sqrt(xp.maximum(room, xp.ones_like(room)))


def i2t_level(continuous_current: Array, level: Array, squared_current: Array, decay: Array) -> Array:
    """The level after a constant current has flowed [-]: the exact solution, for a step of any length.

    Args:
        continuous_current: i_c [A].
        level: before [-].
        squared_current: ``i_d^2 + i_q^2`` [A^2].
        decay: of the time for which it flowed, ``i2t_decay`` [-].
    """
    xp, (continuous, level, squared, decay) = as_arrays(continuous_current, level, squared_current, decay)
    end = squared / continuous**2
    return xp.minimum(end + (level - end) * decay, xp.ones_like(end))


def squared_current(motor: PmsmParameters, output: DriveOutput) -> Array:
    """``i_d^2 + i_q^2`` of what a drive gave [A^2]."""
    _, (torque, constant, direct) = as_arrays(
        output.motor_torque, motor.torque_constant, output.direct_current
    )
    return (torque / constant) ** 2 + direct**2


def i2t_drive(
    motor: PmsmParameters,
    gear: Gear,
    continuous_current: Array,
    level: Array,
    decay: Array,
    desired_joint_torque: Array,
    joint_velocity: Array,
    bus_voltage: Array,
    model: MotorModel = "refined",
) -> tuple[DriveOutput, Array]:
    """One step of ``drive_torque`` with I²t; who calls keeps the level, zero for a cold drive.

    Args:
        motor: parameters, numbers or arrays.
        gear: ratio and efficiency, likewise.
        continuous_current: i_c [A].
        level: U before the step [-].
        decay: of the step, ``i2t_decay`` [-].
        desired_joint_torque: wanted torque on the joint [N m].
        joint_velocity: [rad/s].
        bus_voltage: DC bus [V].
        model: one of ``MOTOR_MODELS``.

    Returns:
        What the drive gives, and the level after the step.

    Raises:
        InvalidValueError: see ``drive_torque``.
    """
    xp, (peak, constant, saturation, level) = as_arrays(
        motor.peak_torque, motor.torque_constant, motor.saturation, level
    )
    allowed = xp.minimum(peak, constant * i2t_current(continuous_current, level, decay))
    # The iron saturates by the current, wherever its limit stands.
    limited = MotorValues.of(motor)._replace(peak_torque=allowed, saturation=saturation * (allowed / peak))
    output = drive_torque(
        cast("PmsmParameters", limited), gear, desired_joint_torque, joint_velocity, bus_voltage, model
    )
    return output, i2t_level(continuous_current, level, squared_current(motor, output), decay)
