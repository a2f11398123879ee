"""Magnetic saturation: the last amperes give less torque than the first."""

from __future__ import annotations

from sprintlab.motors.arrays import Array, as_arrays
from sprintlab.motors.parameters import PmsmParameters


def saturate(motor: PmsmParameters, torque: Array) -> Array:
    """Torque on the shaft [N m] for a torque within ``±peak_torque`` asked of the unsaturated motor.

    ``tau_out = tau (1 - alpha |tau| / tau_m)``; at the peak a share alpha is lost.
    """
    xp, (torque, alpha, peak) = as_arrays(torque, motor.saturation, motor.peak_torque)
    return torque * (1.0 - alpha * xp.abs(torque) / peak)


def desaturate(motor: PmsmParameters, torque: Array) -> Array:
    """Torque to ask for [N m] so that ``saturate`` gives ``torque`` on the shaft [N m]: its inverse.

    Written as ``2 tau / (1 + sqrt(1 - 4 alpha |tau| / tau_m))``, which holds for alpha = 0 as well. Where
    more than the greatest output ``(1 - alpha) tau_m`` is wanted, ``±peak_torque``.
    """
    xp, (torque, alpha, peak) = as_arrays(torque, motor.saturation, motor.peak_torque)
    greatest = (1.0 - alpha) * peak
    torque = xp.minimum(xp.maximum(torque, -greatest), greatest)
    # alpha < 0.5 keeps the radicand at (1 - 2 alpha)^2 > 0 or above.
    return 2.0 * torque / (1.0 + xp.sqrt(1.0 - 4.0 * alpha * xp.abs(torque) / peak))
