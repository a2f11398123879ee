"""Heat in the windings: copper loss warms them, and warm copper and magnets give less.

One node: ``C dT/dt = P - (T - T_ambient) / R_th``; or two, winding and housing (``HousedHeat``). Copper
resists ``1 + 0.00393 (T - 20)`` times its value at 20 degrees Celsius; the magnets follow the winding part of
the way and lose flux linearly.

I²t is the drive's own image of that heat: how long an overload may last before the current is cut back.
The drive keeps a first-order image of the windings' heat, the level ``U`` (thermal image of IEC 60255-149):

    dU/dt = ((i_d^2 + i_q^2) / i_c^2 - U) / T ,    U <= 1 ,

with the continuous current ``i_c`` and a time constant ``T``. While ``U`` is below 1 the peak current may
flow; the current is cut back, at last to ``i_c``, so that ``U`` never passes 1. A constant current ``k i_c``
from cold reaches 1 after ``T ln(k^2 / (k^2 - 1))``: so a peak duration, as data sheets print it, gives ``T``.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from sprintlab.core.checks import check_positive, check_range
from sprintlab.core.errors import InvalidValueError
from sprintlab.motors.arrays import Array, as_arrays
from sprintlab.motors.drive import DriveOutput, drive_torque
from sprintlab.motors.envelope import MotorModel
from sprintlab.motors.gear import Gear
from sprintlab.motors.parameters import PmsmParameters, unchecked

COPPER_COEFFICIENT = 0.00393
"""Relative rise of copper's resistance per kelvin, of its value at 20 degrees Celsius [1/K] (IEC 60028)."""

_COPPER_REFERENCE = 20.0  # [degC]
_LEAST_RESISTANCE, _LEAST_FLUX = 0.1, 0.05  # lower bounds, beyond any motor's life
_CAPACITIES, _RESISTANCES = (1e-3, 1e9), (1e-6, 1e6)  # [J/K], [K/W]: beyond, arithmetic ends


@dataclass(frozen=True, kw_only=True)
class WindingHeat:
    """The thermal side of a motor; each field a number, or an array with one motor an element.

    Heat capacity and thermal resistance are hardly ever published. The defaults are an assumption: the
    1.25 K/W and 32 J/K of the MIT Mini Cheetah's firmware (R_TH, INV_M_TH; an 8110 motor), scaled to a motor
    of four times the mass: heat capacity by 4, thermal resistance by the surface, 4^(2/3).
    """

    heat_capacity: Array = 130.0
    """Heat C that warms winding and stator by one kelvin [J/K]."""
    thermal_resistance: Array = 0.5
    """From the winding to the surroundings, R_th [K/W]."""
    ambient_temperature: Array = 25.0
    """Temperature of the surroundings [degC]."""
    reference_temperature: Array = 25.0
    """At which the motor's parameters hold [degC]."""
    flux_coefficient: Array = -0.0011
    """Relative change of the magnets' flux per kelvin [1/K]; NdFeB about -0.0011, SmCo about -0.0004."""
    magnet_share: Array = 0.5
    """The magnets' share of the winding's rise over the surroundings [-]."""

    def __post_init__(self) -> None:
        check_range("heat.heat_capacity", self.heat_capacity, *_CAPACITIES, "J/K")
        check_range("heat.thermal_resistance", self.thermal_resistance, *_RESISTANCES, "K/W")
        check_range("heat.ambient_temperature", self.ambient_temperature, -60.0, 150.0, "degC")
        check_range("heat.reference_temperature", self.reference_temperature, -60.0, 150.0, "degC")
        check_range("heat.flux_coefficient", self.flux_coefficient, -0.01, 0.0, "1/K")
        check_range("heat.magnet_share", self.magnet_share, 0.0, 1.0)


@dataclass(frozen=True, kw_only=True)
class HousedHeat(WindingHeat):
    """Two nodes, winding and housing: a winding warms in half a minute, its housing in ten.

    ``heat_capacity`` C_w is the winding's, ``thermal_resistance`` R_wh lies between winding and housing::

        C_w dT_w/dt = P - (T_w - T_h) / R_wh
        C_h dT_h/dt = (T_w - T_h) / R_wh - (T_h - T_ambient) / R_ha

    Data sheets print R_wh and R_ha and two time constants, ``R_wh C_w`` and ``R_ha C_h``.
    """

    housing_heat_capacity: Array
    """C_h of all that the winding warms: stator, housing, flange [J/K]."""
    housing_thermal_resistance: Array
    """From the housing to the surroundings, R_ha [K/W]."""

    def __post_init__(self) -> None:
        super().__post_init__()
        check_range("heat.housing_heat_capacity", self.housing_heat_capacity, *_CAPACITIES, "J/K")
        resistance = self.housing_thermal_resistance
        check_range("heat.housing_thermal_resistance", resistance, *_RESISTANCES, "K/W")


def warmed_with_housing(
    heat: HousedHeat, winding: Array, housing: Array, copper_loss: Array, duration: float
) -> tuple[Array, Array]:
    """Winding and housing [degC] after a constant loss [W] has heated them for a duration [s].

    The exact solution by the two real time constants of the pair: stable for any duration.
    """
    xp, values = as_arrays(
        winding,
        housing,
        copper_loss,
        heat.ambient_temperature,
        heat.heat_capacity,
        heat.thermal_resistance,
        heat.housing_heat_capacity,
        heat.housing_thermal_resistance,
    )
    winding, housing, loss, ambient, winding_capacity, inner, housing_capacity, outer = values
    housing_end = ambient + outer * loss
    winding_end = housing_end + inner * loss
    above, below = winding - winding_end, housing - housing_end
    # d(above)/dt = -a (above - below), d(below)/dt = b (above - below) - c below
    a, b = 1.0 / (inner * winding_capacity), 1.0 / (inner * housing_capacity)
    c = 1.0 / (outer * housing_capacity)
    fast = 0.5 * (a + b + c + xp.sqrt((a - b - c) ** 2 + 4.0 * a * b))  # rates [1/s]
    slow = a * c / fast
    fast_left, slow_left = xp.exp(-fast * duration), xp.exp(-slow * duration)
    share = (slow_left - fast_left) / (fast - slow)  # e^(At) = slow_left + share (A + slow)
    winding = winding_end + slow_left * above + share * (slow * above - a * (above - below))
    housing = housing_end + slow_left * below + share * (slow * below + b * (above - below) - c * below)
    return winding, housing


def warmed(heat: WindingHeat, temperature: Array, copper_loss: Array, duration: float) -> Array:
    """Temperature of the winding [degC] after a constant loss [W] has heated it for a duration [s].

    The exact solution, ``T_end + (T - T_end) exp(-t / (R_th C))``: stable for any duration.
    """
    xp, (temperature, loss, resistance, capacity, ambient) = as_arrays(
        temperature, copper_loss, heat.thermal_resistance, heat.heat_capacity, heat.ambient_temperature
    )
    end = ambient + resistance * loss
    return end + (temperature - end) * xp.exp(-duration / (resistance * capacity))


def resistance_factor(heat: WindingHeat, temperature: Array) -> Array:
    """Resistance of a winding at a temperature [degC] over its value at the reference temperature."""
    xp, (temperature, reference) = as_arrays(temperature, heat.reference_temperature)
    reference_resistance = 1.0 + COPPER_COEFFICIENT * (reference - _COPPER_REFERENCE)
    factor = (1.0 + COPPER_COEFFICIENT * (temperature - _COPPER_REFERENCE)) / reference_resistance
    return xp.maximum(factor, xp.zeros_like(factor) + _LEAST_RESISTANCE)


def flux_factor(heat: WindingHeat, temperature: Array) -> Array:
    """Flux linkage beside a winding at a temperature [degC] over its value at the reference temperature."""
    xp, (temperature, ambient, reference, coefficient, share) = as_arrays(
        temperature,
        heat.ambient_temperature,
        heat.reference_temperature,
        heat.flux_coefficient,
        heat.magnet_share,
    )
    magnet = ambient + share * (temperature - ambient)
    factor = 1.0 + coefficient * (magnet - reference)
    return xp.maximum(factor, xp.zeros_like(factor) + _LEAST_FLUX)


def heated_motor(motor: PmsmParameters, heat: WindingHeat, temperature: Array) -> PmsmParameters:
    """The motor with a winding at ``temperature`` [degC]; ``InvalidValueError`` where that cannot be.

    The current limit stays, so that the peak torque falls with the flux.
    """
    flux = flux_factor(heat, temperature)
    return replace(
        motor,
        stator_resistance=motor.stator_resistance * resistance_factor(heat, temperature),
        flux_linkage=motor.flux_linkage * flux,
        peak_torque=motor.peak_torque * flux,
    )


@dataclass(frozen=True, kw_only=True)
class I2tLimit:
    """How a drive cuts overloads back; each field a number, or an array with one motor an element.

    The peak current is the motor's: ``peak_torque / torque_constant``.
    """

    continuous_current: Array
    """Amplitude i_c of the phase current that may flow for ever, ``sqrt(i_d^2 + i_q^2)`` [A]."""
    peak_duration: Array | None = None
    """For which the peak current may flow from cold [s]."""
    time_constant: Array | None = None
    """T of the level, e.g. a data sheet's thermal time constant of the winding [s]."""

    def __post_init__(self) -> None:
        check_range("i2t.continuous_current", self.continuous_current, 1e-3, 1e5, "A")
        given = {name: getattr(self, name) for name in ("peak_duration", "time_constant")}
        given = {name: value for name, value in given.items() if value is not None}
        if len(given) != 1:
            raise InvalidValueError("i2t", sorted(given), "give peak_duration or time_constant, one of them")
        for name, value in given.items():
            check_range(f"i2t.{name}", value, 1e-3, 1e6, "s")


def i2t_time_constant(limit: I2tLimit, motor: PmsmParameters) -> Array:
    """Time constant T of the level [s], in the shape of limit and motor broadcast."""
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
    """Share of the level that is left after ``duration`` [s] without current."""
    check_positive("duration", duration, "s")
    xp, (time_constant,) = as_arrays(i2t_time_constant(limit, motor))
    return xp.exp(-duration / time_constant)


def i2t_current(continuous_current: Array, level: Array, decay: Array) -> Array:
    """Greatest constant current after which the level U is at most 1 [A]; far above any peak while it is low.

    ``decay`` is that over the time for which the current flows (``i2t_decay``).
    """
    xp, (continuous, level, decay) = as_arrays(continuous_current, level, decay)
    room = (1.0 - level * decay) / (1.0 - decay)
    return continuous * xp.sqrt(xp.maximum(room, xp.ones_like(room)))


def i2t_level(continuous_current: Array, level: Array, squared_current: Array, decay: Array) -> Array:
    """The level after a constant ``i_d^2 + i_q^2`` [A^2] has flowed: exact for a step of any length."""
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
    """One step of ``drive_torque`` with I²t: what the drive gives, and the level U after the step.

    The caller keeps the level, zero for a cold drive; ``decay`` is that over the step, ``i2t_decay``.
    """
    xp, (peak, constant, saturation, level) = as_arrays(
        motor.peak_torque, motor.torque_constant, motor.saturation, level
    )
    allowed = xp.minimum(peak, constant * i2t_current(continuous_current, level, decay))
    # The iron saturates by the current, wherever its limit stands.
    limited = unchecked(
        PmsmParameters,
        {**vars(motor), "peak_torque": allowed, "saturation": saturation * (allowed / peak)},
    )
    output = drive_torque(limited, gear, desired_joint_torque, joint_velocity, bus_voltage, model)
    return output, i2t_level(continuous_current, level, squared_current(motor, output), decay)
