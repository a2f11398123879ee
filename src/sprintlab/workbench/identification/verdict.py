"""Is a fit fit for use: what makes it worthless, and what a reader must know."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from sprintlab.motors.parameters import PmsmParameters
from sprintlab.workbench.identification.bench import Bench
from sprintlab.workbench.identification.results import ChannelFit, Estimate

_MANY_OUTLIERS = 0.2
_LEAST_EXPLAINED = 0.9
_PATTERN = 0.5  # correlation of neighbouring residuals that noise does not have
_PATTERN_DEVIATIONS = 3.5  # standard deviations of that correlation, 1 / sqrt(n) for noise
_FEWEST_FOR_PATTERN = 15
_SMALL_ERROR = 1e-4  # share of a channel's range: a pattern this small does not matter


def problems(
    estimates: dict[str, Estimate], fits: tuple[ChannelFit, ...], kept: NDArray[np.bool_]
) -> list[str]:
    """What makes a fit unfit for use."""
    found = [
        f"the model explains only {max(fit.explained, 0.0):.0%} of the variation of {fit.name}: this is no "
        "description"
        for fit in fits
        if fit.name != "voltage limit" and fit.explained < _LEAST_EXPLAINED
    ]
    if np.mean(~kept) > _MANY_OUTLIERS:
        found.append(f"{np.mean(~kept):.0%} of the rows are outliers: the model does not describe this bench")
    saturation = estimates["saturation"].value
    if saturation is not None and saturation > 0.49:
        found.append(
            "the saturation runs into 0.5: torque falls with current, or the peak current is too small"
        )
    return found


def outlier_note(kept: NDArray[np.bool_]) -> list[str]:
    """How many rows were set aside, if any."""
    count = int(np.sum(~kept))
    return [f"{count} of {len(kept)} rows are outliers and were set aside"] if count else []


def comparison(estimates: dict[str, Estimate], base: PmsmParameters | None) -> list[str]:
    """Where the fit is far from the base motor."""
    notes: list[str] = []
    for name in ("stator_resistance", "q_axis_inductance", "flux_linkage"):
        estimate, reference = estimates[name], float(getattr(base, name)) if base is not None else 0.0
        if estimate.value and estimate.determined and reference > 0:
            ratio = estimate.value / reference
            if not 0.6 <= ratio <= 1.6:
                notes.append(f"{name} is {ratio:.3g} times that of the base motor: check the units of both")
    return notes


def patterns(
    bench: Bench, fits: tuple[ChannelFit, ...], kept: NDArray[np.bool_], lacking: Sequence[str]
) -> list[str]:
    """Where residuals follow current or speed instead of scattering: the model lacks something there.

    Noise has no memory; the correlation of residuals that are neighbours in current or speed shows one.

    Args:
        bench: the data.
        fits: of the channels.
        kept: rows of the bench that are no outliers ``(n,)``.
        lacking: what each channel's residuals follow by ``lacking_term``.
    """
    notes: list[str] = []
    for fit, term in zip(fits, lacking, strict=True):
        if fit.noise <= _SMALL_ERROR * float(np.max(np.abs(fit.measured))):
            continue
        followed = dict.fromkeys([*_followed(bench, fit, kept), *([term] if term else [])])
        notes += [
            f"the residuals of {fit.name} follow the {name}: the model lacks something there, which the "
            "intervals do not count"
            for name in followed
        ]
    return notes


def _followed(bench: Bench, fit: ChannelFit, kept: NDArray[np.bool_]) -> list[str]:
    used = kept[fit.rows]
    error, rows = (fit.measured - fit.predicted)[used], fit.rows[used]
    return [
        name
        for name, values in (("current", bench.current), ("speed", bench.speed))
        if values is not None and _has_pattern(error[np.argsort(values[rows], kind="stable")])
    ]


def _has_pattern(error: NDArray[np.float64]) -> bool:
    count = len(error)
    energy = float(np.sum(error**2))
    if count < _FEWEST_FOR_PATTERN or energy == 0.0:
        return False
    correlation = float(np.sum(error[1:] * error[:-1])) / energy
    return correlation > max(_PATTERN, _PATTERN_DEVIATIONS / float(np.sqrt(count)))
