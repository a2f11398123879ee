"""How good a policy's own estimate of its body is: velocity, height and foot contact, by speed."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from sprintlab.control import POLICY_RATE_HZ
from sprintlab.core.array_types import FloatArray
from sprintlab.evaluation.results import EstimateBand, Trajectory

BAND_WIDTH = 2.0
"""Width of a speed band [m/s]."""


def estimate_bands(trajectory: Trajectory) -> tuple[EstimateBand, ...]:
    """Errors by band of true speed, slowest first; nothing for a policy without an estimator."""
    if trajectory.estimate is None:
        return ()
    rate = (len(trajectory.time) - 1) / max(float(trajectory.time[-1] - trajectory.time[0]), 1e-9)
    # Estimates are renewed at the policy's rate; between two of them the robot moves on.
    renewed = slice(None, None, max(1, round(rate / POLICY_RATE_HZ)))
    estimate = np.asarray(trajectory.estimate[renewed], dtype=float)
    velocity = body_velocity(trajectory.qpos[renewed, 3:7], trajectory.qvel[renewed, :3])
    error = estimate[:, :4] - np.column_stack((velocity, trajectory.qpos[renewed, 2]))
    right = (estimate[:, 4:] > 0.5) == trajectory.foot_contact[renewed]
    band = np.floor(np.maximum(trajectory.velocity[renewed, 0], 0.0) / BAND_WIDTH).astype(int)
    return tuple(_band(i * BAND_WIDTH, error[band == i], right[band == i]) for i in np.unique(band).tolist())


def body_velocity(quaternion: FloatArray, velocity: FloatArray) -> FloatArray:
    """World velocities ``(N, 3)`` in the frame of a body with unit quaternions ``(N, 4)``, w first."""
    w, axis = quaternion[:, :1], quaternion[:, 1:]
    # Rotation by the inverse: v - 2 w (q x v) + 2 q x (q x v).
    cross = np.cross(axis, velocity)
    return velocity - 2.0 * w * cross + 2.0 * np.cross(axis, cross)


def _band(lower: float, error: FloatArray, right: FloatArray) -> EstimateBand:
    """Errors of velocity and height ``(n, 4)`` and right contacts ``(n, legs)`` as one band."""
    return EstimateBand(
        lower=lower,
        upper=lower + BAND_WIDTH,
        samples=len(error),
        forward_bias=float(error[:, 0].mean()),
        forward_error=math.sqrt(float((error[:, 0] ** 2).mean())),
        velocity_error=math.sqrt(float((error[:, :3] ** 2).sum(axis=1).mean())),
        height_error=math.sqrt(float((error[:, 3] ** 2).mean())),
        contact_accuracy=float(right.mean()),
    )


def merge_bands(bands: Iterable[EstimateBand]) -> tuple[EstimateBand, ...]:
    """Bands of several trials as one for each speed, weighted by their samples."""
    by_speed: dict[float, list[EstimateBand]] = {}
    for band in bands:
        by_speed.setdefault(band.lower, []).append(band)
    return tuple(_merged(by_speed[lower]) for lower in sorted(by_speed))


def _merged(bands: Sequence[EstimateBand]) -> EstimateBand:
    """Bands of one speed as one: means by the number of samples, root mean squares by their squares."""
    weights = [band.samples for band in bands]

    def mean(name: str, power: int = 1) -> float:
        values = [getattr(band, name) ** power for band in bands]
        return float(np.average(values, weights=weights)) ** (1.0 / power)

    means = {name: mean(name) for name in ("forward_bias", "contact_accuracy")}
    roots = {name: mean(name, 2) for name in ("forward_error", "velocity_error", "height_error")}
    return replace(bands[0], samples=sum(weights), **means, **roots)
