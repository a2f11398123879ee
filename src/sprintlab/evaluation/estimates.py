"""How good a policy's own estimate of its body is: velocity, height and foot contact, by speed."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sprintlab.control import POLICY_RATE_HZ
from sprintlab.core.array_types import FloatArray
from sprintlab.core.errors import SimulationError
from sprintlab.evaluation.results import EstimateBand, Trajectory

BAND_WIDTH = 2.0
"""Width of a speed band [m/s]."""

CONTACT_PROBABILITY = 0.5
"""A foot with a higher estimated probability counts as on the ground."""

ESTIMATE_COLUMNS = (
    "speed [m/s]",
    "policy steps",
    "forward bias [m/s]",
    "forward error [m/s]",
    "velocity error [m/s]",
    "height error [cm]",
    "contact right [%]",
)
"""Headings of ``estimate_cells``; errors are root mean squares."""


@dataclass(frozen=True, kw_only=True)
class EstimatePair:
    """Estimate and truth at the moments at which the estimate is new, ``N`` of them.

    Attributes:
        time: [s] ``(N,)``.
        speed: true forward speed in the heading frame [m/s] ``(N,)``.
        estimate: body velocity 3 [m/s], base height 1 [m], probability of foot contact 4 ``(N, 8)``.
        truth: the same from the simulator; contact is 0 or 1 ``(N, 8)``.
    """

    time: FloatArray
    speed: FloatArray
    estimate: FloatArray
    truth: FloatArray


def estimate_pair(trajectory: Trajectory) -> EstimatePair:
    """Estimate beside truth.

    Raises:
        SimulationError: the policy of this trajectory estimates nothing.
    """
    if trajectory.estimate is None:
        raise SimulationError("the trajectory has no estimate: its policy has no estimator")
    rate = (len(trajectory.time) - 1) / max(float(trajectory.time[-1] - trajectory.time[0]), 1e-9)
    # Estimates are renewed at the policy's rate; between two of them the truth moves on.
    fresh = slice(None, None, max(1, round(rate / POLICY_RATE_HZ)))
    return EstimatePair(
        time=trajectory.time[fresh],
        speed=trajectory.velocity[fresh, 0],
        estimate=np.asarray(trajectory.estimate[fresh], dtype=float),
        truth=_truth(trajectory, fresh),
    )


def estimate_bands(trajectory: Trajectory) -> tuple[EstimateBand, ...]:
    """Errors by band of true speed, slowest first; nothing for a policy without an estimator."""
    if trajectory.estimate is None:
        return ()
    pair = estimate_pair(trajectory)
    band = np.floor(np.maximum(pair.speed, 0.0) / BAND_WIDTH).astype(int)
    return tuple(_band(pair, index, band == index) for index in np.unique(band).tolist())


def merge_bands(bands: Iterable[EstimateBand]) -> tuple[EstimateBand, ...]:
    """Bands of several trials as one for each speed, weighted by their samples."""
    merged: dict[float, EstimateBand] = {}
    for band in bands:
        before = merged.get(band.lower)
        merged[band.lower] = band if before is None else _sum(before, band)
    return tuple(merged[lower] for lower in sorted(merged))


def total_band(bands: Iterable[EstimateBand]) -> EstimateBand | None:
    """All bands as one; ``None`` without any."""
    total = None
    for band in bands:
        total = band if total is None else _sum(total, band)
    return total


def estimate_cells(bands: Sequence[EstimateBand]) -> Iterator[tuple[str, ...]]:
    """One row a speed band, and one for all of them, as text under ``ESTIMATE_COLUMNS``."""
    total = total_band(bands)
    rows = [(f"{band.lower:g} to {band.upper:g}", band) for band in bands]
    for name, band in rows + ([("all", total)] if total is not None else []):
        yield (
            name,
            str(band.samples),
            f"{band.forward_bias:+.2f}",
            f"{band.forward_error:.2f}",
            f"{band.velocity_error:.2f}",
            f"{100 * band.height_error:.1f}",
            f"{100 * band.contact_accuracy:.1f}",
        )


def _truth(trajectory: Trajectory, fresh: slice) -> FloatArray:
    """What the simulator knows ``(N, 8)``."""
    velocity = body_velocity(trajectory.qpos[fresh, 3:7], trajectory.qvel[fresh, :3])
    height = trajectory.height[fresh, None]
    return np.concatenate((velocity, height, trajectory.foot_contact[fresh].astype(float)), axis=1)


def body_velocity(quaternion: FloatArray, velocity: FloatArray) -> FloatArray:
    """World velocities ``(N, 3)`` in the frame of a body with unit quaternions ``(N, 4)``, w first."""
    w, axis = quaternion[:, :1], quaternion[:, 1:]
    # Rotation by the inverse: v - 2 w (q x v) + 2 q x (q x v).
    cross = np.cross(axis, velocity)
    return velocity - 2.0 * w * cross + 2.0 * np.cross(axis, cross)


def _band(pair: EstimatePair, index: int, chosen: NDArray[np.bool_]) -> EstimateBand:
    error = pair.estimate[chosen] - pair.truth[chosen]
    contact = (pair.estimate[chosen, 4:] > CONTACT_PROBABILITY) == (pair.truth[chosen, 4:] > 0.5)
    return EstimateBand(
        lower=index * BAND_WIDTH,
        upper=(index + 1) * BAND_WIDTH,
        samples=int(chosen.sum()),
        forward_bias=float(error[:, 0].mean()),
        forward_error=_root_mean_square(error[:, 0]),
        velocity_error=_root_mean_square(np.linalg.norm(error[:, :3], axis=1)),
        height_error=_root_mean_square(error[:, 3]),
        contact_accuracy=float(contact.mean()),
    )


def _root_mean_square(values: FloatArray) -> float:
    return math.sqrt(float((values**2).mean()))


def _sum(first: EstimateBand, second: EstimateBand) -> EstimateBand:
    """Both together: means by the number of samples, root mean squares by their squares."""
    samples = first.samples + second.samples
    share = second.samples / samples

    def mean(name: str) -> float:
        return (1.0 - share) * getattr(first, name) + share * getattr(second, name)

    def root(name: str) -> float:
        return math.sqrt((1.0 - share) * getattr(first, name) ** 2 + share * getattr(second, name) ** 2)

    return replace(
        first,
        lower=min(first.lower, second.lower),
        upper=max(first.upper, second.upper),
        samples=samples,
        forward_bias=mean("forward_bias"),
        contact_accuracy=mean("contact_accuracy"),
        **{name: root(name) for name in ("forward_error", "velocity_error", "height_error")},
    )
