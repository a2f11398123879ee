"""Magnetic saturation: the last amperes give less torque than the first."""

from __future__ import annotations

from sprintlab.motors.arrays import Array, as_arrays
from sprintlab.motors.parameters import PmsmParameters


def saturate(motor: PmsmParameters, torque: Array) -> Array:
    """Torque that comes out for a torque asked of the unsaturated motor.

    ``tau_out = tau (1 - alpha |tau| / tau_m)``; at the peak a share alpha is lost.

    Args:
        motor: parameters, numbers or arrays that broadcast with ``torque``.
        torque: motor torque after the clip to ``torque_limits`` [N m], within ``±peak_torque``.

    Returns:
        Torque on the motor's shaft [N m], in the broadcast shape.
    """
    xp, (torque, alpha, peak) = as_arrays(torque, motor.saturation, motor.peak_torque)
    return torque * (1.0 - alpha * xp.abs(torque) / peak)


def desaturate(motor: PmsmParameters, torque: Array) -> Array:
    """Torque to ask for so that ``saturate`` gives ``torque``: its inverse.

    Written as ``2 tau / (1 + sqrt(1 - 4 alpha |tau| / tau_m))``, which holds for alpha = 0 as well.

    Args:
        motor: parameters, numbers or arrays that broadcast with ``torque``.
        torque: torque wanted on the motor's shaft [N m].

    Returns:
        Torque before saturation [N m], in the broadcast shape. Where more than the greatest output
        ``(1 - alpha) tau_m`` is wanted, ``±peak_torque``.
    """
    xp, (torque, alpha, peak) = as_arrays(torque, motor.saturation, motor.peak_torque)
    greatest = (1.0 - alpha) * peak
    torque = xp.minimum(xp.maximum(torque, -greatest), greatest)
    # alpha < 0.5 keeps the radicand at (1 - 2 alpha)^2 > 0 or above.
    return 2.0 * torque / (1.0 + xp.sqrt(1.0 - 4.0 * alpha * xp.abs(torque) / peak))
