"""Heat in the windings: copper loss warms them, and warm copper and magnets give less.

One node: ``C dT/dt = P - (T - T_ambient) / R_th``; or two, winding and housing (``HousedHeat``). Copper
resists ``1 + 0.00393 (T - 20)`` times its value at 20 degrees Celsius; the magnets follow the winding part of
the way and lose flux linearly.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from sprintlab.core.checks import check_range
from sprintlab.motors.arrays import Array, as_arrays
from sprintlab.motors.parameters import PmsmParameters

COPPER_COEFFICIENT = 0.00393
"""Relative rise of copper's resistance per kelvin, of its value at 20 degrees Celsius [1/K] (IEC 60028)."""

_COPPER_REFERENCE = 20.0  # [degC]
_LEAST_RESISTANCE = (
    0.1  # floors of the factors, far outside any motor's life, so that nothing divides by zero
)
_LEAST_FLUX = 0.05
_CAPACITIES, _RESISTANCES = (1e-3, 1e9), (1e-6, 1e6)  # [J/K], [K/W]: beyond, arithmetic ends


@dataclass(frozen=True, kw_only=True)
class WindingHeat:
    """The thermal side of a motor; each field a number, or an array with one motor an element.

    Heat capacity and thermal resistance are hardly ever published. The defaults are an assumption: the
    1.25 K/W and 32 J/K of the MIT Mini Cheetah's firmware (R_TH, INV_M_TH; an 8110 motor), scaled to a motor
    of four times the mass: heat capacity by 4, thermal resistance by the surface, 4^(2/3).

    Raises:
        InvalidValueError: a value is impossible.
    """

    heat_capacity: Array = 130.0
    """Heat C that warms winding and stator by one kelvin [J/K]."""
    thermal_resistance: Array = 0.5
    """From the winding to the surroundings, R_th [K/W]."""
    ambient_temperature: Array = 25.0
    """Of the surroundings [degC]."""
    reference_temperature: Array = 25.0
    """At which the motor's parameters hold [degC]."""
    flux_coefficient: Array = -0.0011
    """Relative change of the magnets' flux per kelvin [1/K]; NdFeB about -0.0011, SmCo about -0.0004."""
    magnet_share: Array = 0.5
    """The magnets' share of the winding's rise over the surroundings [-]."""

    def __post_init__(self) -> None:
        """Refuse what cannot be."""
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

    Raises:
        InvalidValueError: a value is impossible.
    """

    housing_heat_capacity: Array
    """C_h of all that the winding warms: stator, housing, flange [J/K]."""
    housing_thermal_resistance: Array
    """From the housing to the surroundings, R_ha [K/W]."""

    def __post_init__(self) -> None:
        """Refuse what cannot be."""
        super().__post_init__()
        check_range("heat.housing_heat_capacity", self.housing_heat_capacity, *_CAPACITIES, "J/K")
        resistance = self.housing_thermal_resistance
        check_range("heat.housing_thermal_resistance", resistance, *_RESISTANCES, "K/W")


def warmed_with_housing(
    heat: HousedHeat, winding: Array, housing: Array, copper_loss: Array, duration: float
) -> tuple[Array, Array]:
    """Temperatures of winding and housing after a constant loss has heated them for a duration.

    The exact solution by the two real time constants of the pair: stable for any duration.

    Args:
        heat: the thermal side, numbers or arrays that broadcast with the temperatures.
        winding: temperature before [degC].
        housing: temperature before [degC].
        copper_loss: [W].
        duration: [s].

    Returns:
        Winding and housing [degC], in the broadcast shape.
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
    a, b, c = (
        1.0 / (inner * winding_capacity),
        1.0 / (inner * housing_capacity),
        1.0 / (outer * housing_capacity),
    )
    fast = 0.5 * (a + b + c + xp.sqrt((a - b - c) ** 2 + 4.0 * a * b))  # rates [1/s]
    slow = a * c / fast
    fast_left, slow_left = xp.exp(-fast * duration), xp.exp(-slow * duration)
    share = (slow_left - fast_left) / (fast - slow)  # e^(At) = slow_left + share (A + slow)
    winding = winding_end + slow_left * above + share * (slow * above - a * (above - below))
    housing = housing_end + slow_left * below + share * (slow * below + b * (above - below) - c * below)
    return winding, housing


def warmed(heat: WindingHeat, temperature: Array, copper_loss: Array, duration: float) -> Array:
    """Temperature of the winding after a constant loss has heated it for a duration.

    The exact solution, ``T_end + (T - T_end) exp(-t / (R_th C))``: stable for any duration.

    Args:
        heat: the thermal side, numbers or arrays that broadcast with ``temperature``.
        temperature: of the winding before [degC].
        copper_loss: [W], broadcasts with ``temperature``.
        duration: [s].

    Returns:
        [degC], in the broadcast shape.
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
    """The motor as it is with a winding at ``temperature`` [degC].

    The current limit stays, so that the peak torque falls with the flux.

    Raises:
        InvalidValueError: no motor could be that hot; see ``PmsmParameters``.
    """
    flux = flux_factor(heat, temperature)
    return replace(
        motor,
        stator_resistance=motor.stator_resistance * resistance_factor(heat, temperature),
        flux_linkage=motor.flux_linkage * flux,
        peak_torque=motor.peak_torque * flux,
    )
