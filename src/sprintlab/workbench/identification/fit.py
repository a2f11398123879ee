"""The fit: robust first, then exact without the outliers, with intervals that say what the data know.

1. Least squares with the soft-L1 loss over all channels in the unit of their own noise, which is estimated
   from the median absolute residual; repeated until the noise settles.
2. Rows with a residual beyond five noise units are set aside and reported.
3. Plain least squares on the rest; its Jacobian ``J`` and residuals give 95 % intervals (``statistics``), the
   singular values of ``J`` say which combination of parameters the data cannot tell apart.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sprintlab.core.array_types import FloatArray
from sprintlab.core.checks import check_choice, check_positive, check_range
from sprintlab.core.errors import SprintlabError
from sprintlab.motors.parameters import PmsmParameters
from sprintlab.motors.voltage import VOLTAGE_UTILIZATION
from sprintlab.workbench.identification.bench import Bench
from sprintlab.workbench.identification.checks import (
    check_levels,
    check_units,
    torque_flux,
    voltage_flux,
)
from sprintlab.workbench.identification.model import (
    NEUTRAL,
    OPTIONAL_UNITS,
    PARAMETER_UNITS,
    PARAMETERS,
    STANDING,
    Channel,
    Sizes,
    channels,
    directions,
    turns,
    warming,
)
from sprintlab.workbench.identification.results import ChannelFit, Estimate, Identification
from sprintlab.workbench.identification.statistics import (
    Decomposition,
    fault_of_bench,
    freedom,
    half_widths,
    local_median,
)
from sprintlab.workbench.identification.verdict import (
    comparison,
    magnets,
    patterns,
    problems,
)

BoolArray = NDArray[np.bool_]

OUTLIER_DISTANCE = 5.0
"""Residual in units of the noise, of rows that read about the same, beyond which a row is set aside."""

_ROUNDS = 4
_MOST_ROWS = 40_000  # that are fitted: more takes longer than 10 s, and tells no more
_MOST_STEPS = 100  # steps of one round; fits that converge take some twenty
_FIRST_NOISE = 0.02  # share of a channel's range, until its residuals tell better
_FEWEST_FOR_OUTLIERS = 8  # rows of a channel: the median of fewer is no measure of their noise
_SMALLEST_NOISE = 1e-7  # share of a channel's range: noiseless data must not divide by zero
_SMALL_EFFECT = 0.05  # an interval that moves a channel by less than this share of its range is no ignorance
_PART = 0.3  # least component of a parameter in a blind direction to be named


def identify(
    bench: Bench,
    *,
    pole_pairs: int,
    peak_current: float | None = None,
    base: PmsmParameters | None = None,
    hold: Sequence[str] = (),
    also: Sequence[str] = (),
) -> Identification:
    """Fit what the columns of a bench allow.

    Args:
        bench: at least current and torque; without speed only flux and saturation are fitted.
        pole_pairs: N.
        peak_current: amplitude of the drive's current limit [A]; the largest of the bench when left out.
        base: a motor that supplies held values and is compared with.
        hold: parameters taken from ``base`` (gamma: 0.95, friction and flux's drift: 0) and not fitted.
        also: names in ``OPTIONAL_UNITS`` that are fitted too.
    """
    check_range("pole_pairs", pole_pairs, 1, 200)
    for name in hold:
        check_choice("hold", name, tuple(PARAMETER_UNITS))
    for name in also:
        check_choice("also", name, tuple(OPTIONAL_UNITS))
    if "rotor_inertia" in also and bench.acceleration is None:
        raise SprintlabError("rotor_inertia needs accelerations: a log with times and speeds")
    if bench.size > _MOST_ROWS:
        raise SprintlabError(
            f"the bench has {bench.size} rows, and at most {_MOST_ROWS} are fitted: leave out some, or give "
            "a log its column 'time [s]', so that windows of it are averaged"
        )
    bench, standing = _without_noise_of_standing(bench)
    if peak_current is not None:
        check_positive("peak_current", peak_current, "A")
    check_levels(bench)
    warnings = [*bench.remarks, *standing, *check_units(bench, pole_pairs)]
    largest = float(np.max(np.abs(bench.current)))
    if peak_current is None:
        peak_current = largest
        warnings.append(
            f"no peak current given: saturation and peak torque refer to {largest:.4g} A, the bench's"
        )
    elif peak_current > 1.2 * largest:
        warnings.append(
            f"the bench ends at {largest:.4g} A: up to {peak_current:.4g} A the saturation is extrapolated"
        )
    electrical = bench.q_voltage is not None or bench.power is not None
    if electrical and bench.temperature is None and "stator_resistance" not in hold:
        warnings.append("no temperature column: the resistance is that of the winding as warm as it was")
    return _Fit(bench, pole_pairs, peak_current, _held_values(base, hold), also).run(warnings, base)


def _without_noise_of_standing(bench: Bench) -> tuple[Bench, list[str]]:
    """The bench with speed 0 in every row if none turns, and a note on rows that stand."""
    standing = int(np.sum(directions(bench) == 0.0)) if bench.speed is not None else 0
    if standing == 0:
        return bench, []
    if standing == bench.size:
        note = f"no row turns faster than {STANDING:g} rad/s: friction stays unknown, and is in the torque"
        return replace(bench, speed=np.zeros(bench.size)), [note]
    if turns(bench):
        said = "friction may point either way, the torque leaves them out"
        return bench, [f"{standing} of {bench.size} rows stand still: {said}"]
    said = "the motor counts as stalled, and the torque leaves them out; friction stays unknown"
    return bench, [f"only {bench.size - standing} of {bench.size} rows turn: {said}"]


def _held_values(base: PmsmParameters | None, hold: Sequence[str]) -> dict[str, float]:
    held = {name: 0.0 for name in hold if name.endswith("friction") or name == "flux_drift"}
    held |= {name: VOLTAGE_UTILIZATION for name in hold if name == "voltage_utilization"}
    for name in hold:
        if name not in held and base is None:
            raise SprintlabError(f"{name} cannot be held: give the base motor that it comes from")
    return held | {name: float(getattr(base, name)) for name in hold if name not in held}


class _Fit:
    """One fit over the channels of a bench; parameters travel in units of their first guess."""

    def __init__(
        self, bench: Bench, pole_pairs: int, peak_current: float, held: dict[str, float], also: Sequence[str]
    ) -> None:
        self._bench = bench
        self._pole_pairs = pole_pairs
        self._peak_current = peak_current
        self._held = held
        self._channels = channels(bench, pole_pairs, peak_current, also)
        self._names = (*PARAMETER_UNITS, *dict.fromkeys(also))
        seen = {name for channel in self._channels for name in channel.depends_on}
        self._free = [name for name in self._names if name in seen and name not in held]
        self._sizes = self._measured_sizes()
        self._start = np.array([PARAMETERS[name].guess(self._sizes) for name in self._free])
        self._idle = NEUTRAL | held

    def run(self, warnings: list[str], base: PmsmParameters | None) -> Identification:
        """Fit, and say how good it is."""
        solution, kept = self._fitted()
        decomposition = Decomposition(solution.jac)
        widths = half_widths(decomposition, solution.fun, self._used_rows(kept)) * self._start
        fits = tuple(self._channel_fit(channel, solution.x, kept) for channel in self._channels)
        estimates = self._estimates(solution.x, widths, decomposition)
        fatal, aside = problems(estimates, fits, kept), int(np.sum(~kept))
        notes = [*comparison(estimates, base), *magnets(estimates)]
        notes += [f"{aside} of {len(kept)} rows are outliers and were set aside"] if aside else []
        fault = fault_of_bench(self._bench, self._channels[0], kept, decomposition, solution.fun)
        return Identification(
            bench=self._bench,
            pole_pairs=self._pole_pairs,
            peak_current=self._peak_current,
            estimates=estimates,
            channels=fits,
            outliers=self._bench.lines[~kept],
            singular_values=decomposition.singular,
            warnings=(*fatal, *warnings, *notes, *patterns(self._bench, fits, kept, fault)),
            trustworthy=not fatal,
        )

    def _fitted(self) -> tuple[Any, BoolArray]:
        """The solution over the rows that are no outliers, and which rows those are."""
        noise = np.array([_FIRST_NOISE * _range(channel, self._bench) for channel in self._channels])
        everything = np.ones(self._bench.size, dtype=bool)
        point = np.ones(len(self._free))
        for _ in range(_ROUNDS):
            point = self._solve(point, noise, everything, "soft_l1").x
            noise = self._noise(point)
        kept = ~self._outlying(point, noise)
        solution = self._solve(point, noise, kept, "linear")
        noise = self._residual_spread(solution, noise, kept)
        return self._solve(solution.x, noise, kept, "linear"), kept

    def _measured_sizes(self) -> Sizes:
        bench, flux = self._bench, torque_flux(self._bench, self._pole_pairs)
        speed = 1.0 if bench.speed is None else max(_largest(bench.speed), 1e-6)
        voltage = self._pole_pairs * speed * flux
        if bench.q_voltage is not None:
            voltage = max(_largest(bench.q_voltage), 1e-6)
        electrical = voltage_flux(bench, self._pole_pairs)
        return Sizes(
            pole_pairs=self._pole_pairs,
            current=_largest(bench.current),
            torque=_largest(bench.torque),
            speed=speed,
            voltage=voltage,
            acceleration=1.0 if bench.acceleration is None else max(_largest(bench.acceleration), 1e-6),
            warming=max(warming(bench), 1.0),
            flux=flux,
            resistance=electrical[1] if electrical is not None else 0.0,
        )

    def _values(self, point: FloatArray) -> dict[str, float]:
        return self._idle | dict(zip(self._free, (point * self._start).tolist(), strict=True))

    def _residuals(self, point: FloatArray, noise: FloatArray, kept: BoolArray) -> FloatArray:
        values = self._values(point)
        return np.concatenate(
            [
                ((channel.predict(values) - channel.measured) / scale)[kept[channel.rows]]
                for channel, scale in zip(self._channels, noise.tolist(), strict=True)
            ]
        )

    def _solve(self, point: FloatArray, noise: FloatArray, kept: BoolArray, loss: str) -> Any:
        from scipy import optimize  # pyright: ignore[reportMissingTypeStubs]

        untyped: Any = optimize
        kinds = [PARAMETERS[name] for name in self._free]
        low = np.array([kind.low for kind in kinds]) / self._start
        high = np.array([kind.high for kind in kinds]) / self._start
        inside = np.clip(point, low + 1e-9, high - 1e-9)
        try:
            return untyped.least_squares(
                self._residuals,
                inside,
                bounds=(low, high),
                loss=loss,
                args=(noise, kept),
                jac="3-point",
                x_scale="jac",
                max_nfev=_MOST_STEPS,
            )
        except ValueError as error:  # what it begins with is not finite
            raise SprintlabError(f"the motor cannot be fitted: {error}") from error

    def _noise(self, point: FloatArray) -> FloatArray:
        """Median absolute residual of each channel as a standard deviation."""
        values = self._values(point)
        spread = [
            1.4826 * float(np.median(np.abs(channel.predict(values) - channel.measured)))
            for channel in self._channels
        ]
        return self._floored(spread)

    def _residual_spread(self, solution: Any, noise: FloatArray, kept: BoolArray) -> FloatArray:
        """Standard deviation of each channel without outliers and without the freedom that the fit took."""
        used = self._used_rows(kept)
        spread: list[float] = []
        start = 0
        for index, left in enumerate(freedom(Decomposition(solution.jac), used)):
            error = solution.fun[start : start + used[index]] * noise[index]
            start += used[index]
            known = left >= 1.0  # else the fit took every row: no row is left to show the noise
            unknown = _FIRST_NOISE * _range(self._channels[index], self._bench)
            spread.append(float(np.sqrt(np.sum(error**2) / left)) if known else unknown)
        return self._floored(spread)

    def _used_rows(self, kept: BoolArray) -> list[int]:
        """Residuals that each channel adds."""
        return [int(kept[channel.rows].sum()) for channel in self._channels]

    def _floored(self, spread: list[float]) -> FloatArray:
        floor = [_SMALLEST_NOISE * _range(channel, self._bench) for channel in self._channels]
        return np.maximum(np.array(spread), np.array(floor))

    def _outlying(self, point: FloatArray, noise: FloatArray) -> BoolArray:
        """Rows with a residual too far off in any channel ``(n,)``."""
        values = self._values(point)
        outlying = np.zeros(self._bench.size, dtype=bool)
        for channel, scale in zip(self._channels, noise.tolist(), strict=True):
            if len(channel.rows) < _FEWEST_FOR_OUTLIERS:
                continue
            predicted = channel.predict(values)
            error = np.abs(predicted - channel.measured)
            spread = np.maximum(scale, 1.4826 * local_median(np.abs(predicted), error))
            outlying[channel.rows[error > OUTLIER_DISTANCE * spread]] = True
        return outlying

    def _estimates(
        self, point: FloatArray, widths: FloatArray, decomposition: Decomposition
    ) -> dict[str, Estimate]:
        values = self._values(point)
        half_width = dict(zip(self._free, widths.tolist(), strict=True))
        blind = [
            [self._free[index] for index in np.flatnonzero(np.abs(direction) > _PART)]
            for direction in decomposition.blind_directions
        ]
        found: dict[str, Estimate] = {}
        for name in self._names:
            value, width, reason = values[name], half_width.get(name), ""
            if width is not None:
                reason = self._ignorance(name, value, width, blind)
            elif name not in self._held:
                value, reason = None, PARAMETERS[name].absence
            determined = name in self._held or not reason
            reason = "held" if name in self._held else reason
            found[name] = Estimate(
                name=name, value=value, half_width=width, determined=determined, reason=reason
            )
        return found

    def _ignorance(self, name: str, value: float, width: float, blind: list[list[str]]) -> str:
        """Why a fitted parameter is not determined; empty where it is."""
        together = next((names for names in blind if name in names), [])
        if len(together) > 1:
            return f"the data do not tell apart {' and '.join(together)}"
        if together:
            return "leaves no trace in the data"
        kind = PARAMETERS[name]
        if width <= max(kind.share * abs(value), _SMALL_EFFECT * kind.effect(self._sizes)):
            return ""
        more = "rows on the limit" if name == "voltage_utilization" else "speeds and currents"
        return f"the interval is too wide: more {more} are needed"

    def _channel_fit(self, channel: Channel, point: FloatArray, kept: BoolArray) -> ChannelFit:
        values = self._values(point)
        predicted = channel.predict(values)
        used = kept[channel.rows]
        error, measured = (channel.measured - predicted)[used], channel.measured[used]
        variance = float(np.var(measured)) if len(measured) else 0.0
        explained = 1.0 - float(np.mean(error**2)) / variance if variance > 0 else 1.0
        return ChannelFit(
            name=channel.name,
            unit=channel.unit,
            rows=channel.rows,
            measured=channel.measured,
            predicted=predicted,
            noise=float(np.sqrt(np.mean(error**2))) if len(error) else 0.0,
            explained=explained,
        )


def _largest(values: FloatArray) -> float:
    return float(np.max(np.abs(values)))


def _range(channel: Channel, bench: Bench) -> float:
    """Size of what a channel measures; of the bus voltage where the channel measures zero."""
    largest = _largest(channel.measured)
    if largest == 0.0 and bench.bus_voltage is not None:
        largest = _largest(bench.bus_voltage)
    return max(largest, 1e-9)
