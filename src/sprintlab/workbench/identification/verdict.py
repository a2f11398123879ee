"""Is a fit fit for use: what makes it worthless, and what a reader must know."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from sprintlab.motors.parameters import PmsmParameters
from sprintlab.workbench.identification.bench import Bench
from sprintlab.workbench.identification.model import PARAMETERS, directions, turns
from sprintlab.workbench.identification.results import ChannelFit, Estimate
from sprintlab.workbench.identification.statistics import LARGE, LOAD_LOSS

_MANY_OUTLIERS = 0.2
_NEAR_BASE = {"stator_resistance": (0.6, 1.6), "q_axis_inductance": (0.6, 1.6), "flux_linkage": (0.9, 1.1)}
_MAGNETS = (-0.0022, 0.0002)  # [1/K]: ferrite -0.2 %, neodymium -0.12 %, samarium-cobalt -0.04 %
_LEAST_EXPLAINED = 0.9
_CHANCE = 1e-5  # probability that residuals which only scatter pass for a pattern
_LEVEL = 0.2  # share of the range of current or speed that makes one group
_FEWEST_IN_GROUP = 10  # rows, to know the mean and the spread of a group
_FEWEST_GROUPS = 3
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
    if (estimates["saturation"].value or 0.0) > 0.49:
        cause = "torque falls with current, or the peak current is too small"
        found.append(f"the saturation runs into 0.5: {cause}")
    return found


def comparison(estimates: dict[str, Estimate], base: PmsmParameters | None) -> list[str]:
    """Where the fit is far from the base motor."""
    notes: list[str] = []
    for name, (low, high) in _NEAR_BASE.items():
        value, reference = estimates[name].value, float(getattr(base, name, 0.0))
        if value and estimates[name].determined and reference > 0 and not low <= value / reference <= high:
            advice = "check the units of both and the gains of the sensors"
            notes.append(f"{name} is {value / reference:.3g} times that of the base motor: {advice}")
    return notes


def magnets(estimates: dict[str, Estimate]) -> list[str]:
    """A flux that drifts as no magnet does, with which the flux at 20 degC is wrong too."""
    drift = estimates["flux_drift"]
    if drift.value is None or drift.half_width is None or drift.reason == "held":
        return []
    (low, high), width = _MAGNETS, drift.half_width
    bounds = PARAMETERS["flux_drift"].low, PARAMETERS["flux_drift"].high
    at_edge = np.isclose(drift.value, bounds, rtol=1e-3).any()
    if low - width <= drift.value <= high + width and not at_edge:
        return []
    return [
        f"flux_drift = {drift.value:.2%} per kelvin is no magnet's (they lose 0.03 % to 0.2 %), and "
        "flux_linkage at 20 degC is wrong with it: something else in the torque goes with the temperature, "
        "or the winding's is not the magnets'; leave the drift out with --hold flux_drift"
    ]


def patterns(bench: Bench, fits: tuple[ChannelFit, ...], kept: NDArray[np.bool_], fault: str) -> list[str]:
    """Where residuals follow current or speed instead of scattering: the model lacks something there.

    Rows at about the same current (or speed) make a group; the mean residuals of the groups must be equal
    within what the scatter in each explains. By chance that fails in one of a
    hundred thousand. ``fault`` is what the torque's residuals follow by ``fault_of_bench``.
    """
    notes: list[str] = []
    for fit in fits:
        if fit.noise <= _SMALL_ERROR * float(np.max(np.abs(fit.measured))):
            continue
        if fit.name == "torque" and fault:
            notes.append(_load_loss(bench, kept) if fault == LOAD_LOSS else _wrong_zero(bench))
            continue
        notes += [
            f"the residuals of {fit.name} follow the {name}: the model lacks something there, which the "
            "intervals do not count"
            for name in _followed(bench, fit, kept)
        ]
    return notes


def _load_loss(bench: Bench, kept: NDArray[np.bool_]) -> str:
    large = kept & (np.abs(bench.current) > LARGE * float(np.max(np.abs(bench.current))))
    drives = np.sign(bench.current) * directions(bench)
    driving, braking = (
        float(np.median(bench.torque[rows] / bench.current[rows]))
        for rows in (np.flatnonzero(large & (drives == way)) for way in (1.0, -1.0))
    )
    return (
        f"an ampere gives {driving:.3g} N m driving and takes {braking:.3g} N m braking: more than friction "
        "does. A gear that loses a share of the load does that: fit it with --also gear_efficiency"
    )


def _wrong_zero(bench: Bench) -> str:
    where = "current and friction: " if turns(bench) else "the current: friction, or "
    return (
        f"the torque does not vanish with {where}a sensor with a wrong zero; fit it with "
        "--also torque_offset, or current_offset"
    )


def _followed(bench: Bench, fit: ChannelFit, kept: NDArray[np.bool_]) -> list[str]:
    used = kept[fit.rows]
    error, rows = (fit.measured - fit.predicted)[used], fit.rows[used]
    return [
        name
        for name, values in (("current", bench.current), ("speed", bench.speed))
        if values is not None and _has_pattern(values[rows], error)
    ]


def _has_pattern(values: NDArray[np.float64], error: NDArray[np.float64]) -> bool:
    """Whether groups of rows at about the same value have different mean residuals (Alexander and Govern)."""
    from scipy import stats  # pyright: ignore[reportMissingTypeStubs]

    order = np.argsort(values, kind="stable")
    ordered, sorted_error = values[order], error[order]
    groups = [sorted_error[begin:end] for begin, end in _groups(ordered, 0, len(ordered))]
    if len(groups) < _FEWEST_GROUPS or any(float(np.ptp(group)) == 0.0 for group in groups):
        return False
    untyped: Any = stats
    return float(untyped.alexandergovern(*groups).pvalue) < _CHANCE


def _groups(ordered: NDArray[np.float64], begin: int, end: int) -> list[tuple[int, int]]:
    """Ranges of rows at about the same value, parted at the widest gaps.

    A sensor's noise spreads one level of current, and within a level the residuals follow that noise. So a
    level must never be parted: only groups wider than a share of the whole range are.
    """
    width = _LEVEL * float(ordered[-1] - ordered[0])
    first, last = begin + _FEWEST_IN_GROUP, end - _FEWEST_IN_GROUP
    if last < first or ordered[end - 1] - ordered[begin] <= width:
        return [(begin, end)]
    cut = first + int(np.argmax(ordered[first : last + 1] - ordered[first - 1 : last]))
    return [*_groups(ordered, begin, cut), *_groups(ordered, cut, end)]
