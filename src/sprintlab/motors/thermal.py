"""Heat in the windings: copper loss warms them, and warm copper and magnets give less.

One node: ``C dT/dt = P - (T - T_ambient) / R_th``. Copper resists ``1 + 0.00393 (T - 20)`` times its value at
20 degrees Celsius; the magnets follow the winding part of the way and lose flux linearly.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from sprintlab.core.checks import check_positive, check_range
from sprintlab.motors.arrays import Array, as_arrays
from sprintlab.motors.parameters import PmsmParameters

COPPER_COEFFICIENT = 0.00393
"""Relative rise of copper's resistance per kelvin, of its value at 20 degrees Celsius [1/K] (IEC 60028)."""

_COPPER_REFERENCE = 20.0  # [degC]
_LEAST_RESISTANCE = (
    0.1  # floors of the factors, far outside any motor's life, so that nothing divides by zero
)
_LEAST_FLUX = 0.05


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
        check_positive("heat.heat_capacity", self.heat_capacity, "J/K")
        check_positive("heat.thermal_resistance", self.thermal_resistance, "K/W")
        check_range("heat.ambient_temperature", self.ambient_temperature, -60.0, 150.0, "degC")
        check_range("heat.reference_temperature", self.reference_temperature, -60.0, 150.0, "degC")
        check_range("heat.flux_coefficient", self.flux_coefficient, -0.01, 0.0, "1/K")
        check_range("heat.magnet_share", self.magnet_share, 0.0, 1.0)


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
