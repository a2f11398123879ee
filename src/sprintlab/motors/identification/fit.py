"""The fit: robust first, then exact on what is no outlier, with intervals that say what the data know.

1. Least squares with the soft-L1 loss over all channels in the unit of their own noise, which is estimated
   from the median absolute residual; repeated until the noise settles.
2. Rows with a residual beyond five noise units are set aside and reported.
3. Plain least squares on the rest; ``(J^T J)^-1`` gives 95 % intervals (Student's t), the singular values of
   ``J`` say which combination of parameters the data cannot tell apart.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sprintlab.core.checks import check_choice, check_positive, check_range
from sprintlab.core.errors import SprintlabError
from sprintlab.core.extras import require_package
from sprintlab.motors.identification.bench import Bench
from sprintlab.motors.identification.checks import check_levels, check_units, torque_flux, voltage_flux
from sprintlab.motors.identification.model import BOUNDS, PARAMETER_UNITS, Channel, channels
from sprintlab.motors.identification.results import ChannelFit, Estimate, Identification
from sprintlab.motors.identification.verdict import comparison, outlier_note, patterns, problems
from sprintlab.motors.parameters import PmsmParameters
from sprintlab.motors.voltage import VOLTAGE_UTILIZATION

FloatArray = NDArray[np.float64]

OUTLIER_DISTANCE = 5.0
"""Residual in units of the noise beyond which a row is set aside."""
CONFIDENCE = 0.95

_ROUNDS = 4
_SMALLEST_NOISE = 1e-7  # share of a channel's range: noiseless data must not divide by zero
_LARGEST_SATURATION_WIDTH = 0.1
_SMALL_EFFECT = 0.05  # an interval that moves a channel by less than this share of its range is no ignorance
_BLIND = 1e-5  # a singular value below this share of the largest sees nothing
_PART = 0.3  # least component of a parameter in a blind direction to be named


def identify(
    bench: Bench,
    *,
    pole_pairs: int,
    peak_current: float | None = None,
    base: PmsmParameters | None = None,
    hold: Sequence[str] = (),
) -> Identification:
    """Fit what the columns of a bench allow.

    Args:
        bench: at least current and torque; without speed only flux and saturation are fitted.
        pole_pairs: N.
        peak_current: amplitude of the drive's current limit [A]; the largest of the bench when left out.
        base: a motor that supplies held values and is compared with.
        hold: parameters taken from ``base`` (gamma: 0.95) and not fitted.

    Raises:
        SprintlabError: too few rows, speeds or currents, or units and signs that contradict each other; or
            SciPy, which the extra ``analysis`` brings, is not installed.
        InvalidValueError: a setting is not allowed.
    """
    require_package("scipy", extra="analysis", use="identifying a motor")
    check_range("pole_pairs", pole_pairs, 1, 200)
    for name in hold:
        check_choice("hold", name, tuple(PARAMETER_UNITS))
    if peak_current is not None:
        check_positive("peak_current", peak_current, "A")
    check_levels(bench)
    warnings = check_units(bench, pole_pairs) if bench.speed is not None else []
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
    return _Fit(bench, pole_pairs, peak_current, _held_values(base, hold)).run(warnings, base)


def _held_values(base: PmsmParameters | None, hold: Sequence[str]) -> dict[str, float]:
    held: dict[str, float] = {}
    for name in hold:
        if name == "voltage_utilization":
            held[name] = VOLTAGE_UTILIZATION
        elif name.endswith("friction"):
            held[name] = 0.0
        elif base is None:
            raise SprintlabError(f"{name} cannot be held: give the base motor that it comes from")
        else:
            held[name] = float(getattr(base, name))
    return held


class _Decomposition:
    """Singular values of a Jacobian with unit columns, and what follows from them.

    Attributes:
        singular: (p,) largest first.
        leverage: (m,) share of each residual that the fit takes for itself.
        gain: (p, m) change of each parameter with each residual.
        blind_directions: unit vectors ``(p,)`` of parameters that no residual sees.
    """

    def __init__(self, jacobian: Any) -> None:
        matrix = np.asarray(jacobian, dtype=float)
        lengths = np.maximum(np.linalg.norm(matrix, axis=0), 1e-300)
        left, self.singular, right = np.linalg.svd(matrix / lengths, full_matrices=False)
        floored = np.maximum(self.singular, 1e-12 * float(self.singular[0]))
        seen = self.singular >= _BLIND * self.singular[0]
        self.leverage: FloatArray = np.sum(left[:, seen] ** 2, axis=1)
        self.gain: FloatArray = (right.T / floored) @ left.T / lengths[:, None]
        self.blind_directions: list[FloatArray] = list(right[~seen])


class _Fit:
    """One fit over the channels of a bench; parameters travel in units of their first guess."""

    def __init__(self, bench: Bench, pole_pairs: int, peak_current: float, held: dict[str, float]) -> None:
        self._bench = bench
        self._pole_pairs = pole_pairs
        self._peak_current = peak_current
        self._held = held
        self._channels = channels(bench, pole_pairs, peak_current)
        seen = {name for channel in self._channels for name in channel.depends_on}
        self._free = [name for name in PARAMETER_UNITS if name in seen and name not in held]
        guess = self._guess()
        self._start = np.array([guess[name] for name in self._free])
        self._idle = {name: 0.0 for name in PARAMETER_UNITS if name not in self._free} | held

    def run(self, warnings: list[str], base: PmsmParameters | None) -> Identification:
        """Fit, and say how good it is."""
        solution, kept = self._fitted()
        widths, singular, blind = self._intervals(solution, kept)
        fits = tuple(self._channel_fit(channel, solution.x, kept) for channel in self._channels)
        estimates = self._estimates(solution.x, widths, blind)
        fatal = problems(estimates, fits, kept)
        notes = [*comparison(estimates, base), *self._at_bounds(solution.x), *outlier_note(kept)]
        return Identification(
            bench=self._bench,
            pole_pairs=self._pole_pairs,
            peak_current=self._peak_current,
            estimates=estimates,
            channels=fits,
            outliers=self._bench.lines[~kept],
            singular_values=singular,
            warnings=(*fatal, *warnings, *notes, *patterns(self._bench, fits, kept)),
            trustworthy=not fatal,
        )

    def _fitted(self) -> tuple[Any, NDArray[np.bool_]]:
        """The solution over the rows that are no outliers, and which rows those are."""
        noise = np.array([0.02 * _range(channel, self._bench) for channel in self._channels])
        everything = np.ones(self._bench.size, dtype=bool)
        point = np.ones(len(self._free))
        for _ in range(_ROUNDS):
            point = self._solve(point, noise, everything, "soft_l1").x
            noise = self._noise(point)
        kept = ~self._outlying(point, noise)
        solution = self._solve(point, noise, kept, "linear")
        noise = self._residual_spread(solution, noise, kept)
        return self._solve(solution.x, noise, kept, "linear"), kept

    def _guess(self) -> dict[str, float]:
        """A first guess of everything; also the unit in which the fit moves."""
        bench, pairs = self._bench, self._pole_pairs
        flux = torque_flux(bench, pairs)
        current = float(np.max(np.abs(bench.current)))
        torque = float(np.max(np.abs(bench.torque)))
        speed = 1.0 if bench.speed is None else max(float(np.max(np.abs(bench.speed))), 1e-6)
        voltage = self._largest_voltage(flux, speed)
        electrical = voltage_flux(bench, pairs)
        resistance = electrical[1] if electrical is not None else 0.0
        return {
            "stator_resistance": resistance if resistance > 0 else 0.1 * voltage / current,
            "q_axis_inductance": 0.2 * voltage / (pairs * speed * current),
            "flux_linkage": flux,
            "saturation": 0.1,
            "coulomb_friction": 0.02 * torque,
            "viscous_friction": 0.02 * torque / speed,
            "voltage_utilization": VOLTAGE_UTILIZATION,
        }

    def _largest_voltage(self, flux: float, speed: float) -> float:
        if self._bench.q_voltage is not None:
            return max(float(np.max(np.abs(self._bench.q_voltage))), 1e-6)
        return self._pole_pairs * speed * flux

    def _values(self, point: FloatArray) -> dict[str, float]:
        return self._idle | dict(zip(self._free, (point * self._start).tolist(), strict=True))

    def _residuals(self, point: FloatArray, noise: FloatArray, kept: NDArray[np.bool_]) -> FloatArray:
        values = self._values(point)
        return np.concatenate(
            [
                ((channel.predict(values) - channel.measured) / scale)[kept[channel.rows]]
                for channel, scale in zip(self._channels, noise.tolist(), strict=True)
            ]
        )

    def _solve(self, point: FloatArray, noise: FloatArray, kept: NDArray[np.bool_], loss: str) -> Any:
        from scipy import optimize  # pyright: ignore[reportMissingTypeStubs]

        untyped: Any = optimize
        low, high = (np.array([BOUNDS[name][end] for name in self._free]) / self._start for end in (0, 1))
        inside = np.clip(point, low + 1e-9, high - 1e-9)
        solution = untyped.least_squares(
            self._residuals,
            inside,
            bounds=(low, high),
            loss=loss,
            args=(noise, kept),
            jac="3-point",
            x_scale="jac",
        )
        if not np.isfinite(solution.x).all():
            raise SprintlabError("the fit found no finite parameters: check the bench's columns and units")
        return solution

    def _noise(self, point: FloatArray) -> FloatArray:
        """Median absolute residual of each channel as a standard deviation."""
        values = self._values(point)
        spread = [
            1.4826 * float(np.median(np.abs(channel.predict(values) - channel.measured)))
            for channel in self._channels
        ]
        return self._floored(spread)

    def _residual_spread(self, solution: Any, noise: FloatArray, kept: NDArray[np.bool_]) -> FloatArray:
        """Standard deviation of each channel without outliers and without the freedom that the fit took."""
        freedom = self._freedom(_Decomposition(solution.jac), kept)
        spread: list[float] = []
        start = 0
        for rows, scale, left in zip(self._used_rows(kept), noise.tolist(), freedom, strict=True):
            error = solution.fun[start : start + rows] * scale
            start += rows
            spread.append(float(np.sqrt(np.sum(error**2) / left)) if left >= 1.0 else scale)
        return self._floored(spread)

    def _used_rows(self, kept: NDArray[np.bool_]) -> list[int]:
        """Residuals that each channel adds."""
        return [int(kept[channel.rows].sum()) for channel in self._channels]

    def _freedom(self, decomposition: _Decomposition, kept: NDArray[np.bool_]) -> list[float]:
        """Residuals less parameters, channel by channel: each row's leverage is what the fit took of it."""
        ends = np.cumsum([0, *self._used_rows(kept)]).tolist()
        taken = decomposition.leverage
        return [float(end - begin - taken[begin:end].sum()) for begin, end in pairwise(ends)]

    def _floored(self, spread: list[float]) -> FloatArray:
        floor = [_SMALLEST_NOISE * _range(channel, self._bench) for channel in self._channels]
        return np.maximum(np.array(spread), np.array(floor))

    def _outlying(self, point: FloatArray, noise: FloatArray) -> NDArray[np.bool_]:
        """Rows with a residual too far off in any channel ``(n,)``."""
        values = self._values(point)
        outlying = np.zeros(self._bench.size, dtype=bool)
        for channel, scale in zip(self._channels, noise.tolist(), strict=True):
            far = np.abs(channel.predict(values) - channel.measured) > OUTLIER_DISTANCE * scale
            outlying[channel.rows[far]] = True
        return outlying

    def _intervals(self, solution: Any, kept: NDArray[np.bool_]) -> tuple[FloatArray, FloatArray, list[str]]:
        """Half widths in SI, singular values of the column-scaled Jacobian, and blind directions in words.

        The noise of a channel is known only as well as its rows allow: the quantile of Student's t takes the
        effective degrees of freedom of each parameter (Welch and Satterthwaite).
        """
        from scipy import special  # pyright: ignore[reportMissingTypeStubs]

        untyped: Any = special
        decomposition = _Decomposition(solution.jac)
        ends = np.cumsum([0, *self._used_rows(kept)]).tolist()
        shares = np.array(
            [np.sum(decomposition.gain[:, begin:end] ** 2, axis=1) for begin, end in pairwise(ends)]
        )
        freedom = np.maximum(np.array(self._freedom(decomposition, kept)), 1.0)[:, None]
        variance = shares.sum(axis=0)
        effective = variance**2 / np.sum(shares**2 / freedom, axis=0)
        quantile = untyped.stdtrit(effective, 0.5 + CONFIDENCE / 2.0)
        blind = [
            " and ".join(self._free[index] for index in np.flatnonzero(np.abs(direction) > _PART))
            for direction in decomposition.blind_directions
        ]
        return quantile * np.sqrt(variance) * self._start, decomposition.singular, blind

    def _estimates(self, point: FloatArray, widths: FloatArray, blind: list[str]) -> dict[str, Estimate]:
        values = self._values(point)
        found: dict[str, Estimate] = {}
        for name in PARAMETER_UNITS:
            if name in self._free:
                width = float(widths[self._free.index(name)])
                found[name] = self._estimate(name, values[name], width, blind)
            elif name in self._held:
                found[name] = Estimate(
                    name=name, value=values[name], half_width=None, determined=True, reason="held"
                )
            else:
                found[name] = Estimate(
                    name=name, value=None, half_width=None, determined=False, reason=self._absence(name)
                )
        return found

    def _estimate(self, name: str, value: float, width: float, blind: list[str]) -> Estimate:
        known = width <= 0.5 * abs(value) or width <= self._harmless_width(name)
        direction = next((text for text in blind if name in text.split(" and ")), "")
        reason = ""
        if direction:
            known = False
            reason = (
                f"the data do not tell apart {direction}"
                if " and " in direction
                else "leaves no trace in the data"
            )
        elif not known:
            reason = "the interval is too wide: more speeds and currents are needed"
        return Estimate(name=name, value=value, half_width=width, determined=known, reason=reason)

    def _harmless_width(self, name: str) -> float:
        """Half width that moves no channel by more than 5 % of its range."""
        bench = self._bench
        current = float(np.max(np.abs(bench.current)))
        torque = _SMALL_EFFECT * float(np.max(np.abs(bench.torque)))
        speed = 1.0 if bench.speed is None else max(float(np.max(np.abs(bench.speed))), 1e-6)
        voltage = _SMALL_EFFECT * self._largest_voltage(self._start[self._free.index("flux_linkage")], speed)
        return {
            "stator_resistance": voltage / current,
            "q_axis_inductance": voltage / (self._pole_pairs * speed * current),
            "saturation": _LARGEST_SATURATION_WIDTH,
            "coulomb_friction": torque,
            "viscous_friction": torque / speed,
        }.get(name, 0.0)

    def _absence(self, name: str) -> str:
        if name in ("stator_resistance", "q_axis_inductance"):
            return "needs vq and vd, or rows marked limited with a bus_voltage"
        if name == "voltage_utilization":
            return "needs a bus_voltage and rows marked limited"
        return "needs speeds"

    def _at_bounds(self, point: FloatArray) -> list[str]:
        values = self._values(point)
        return [
            f"{name} ended at {values[name]:.3g}, the edge of what is possible: the model does not fit there"
            for name in self._free
            if name != "voltage_utilization"
            and _at_edge(name, values[name], self._start[self._free.index(name)])
        ]

    def _channel_fit(self, channel: Channel, point: FloatArray, kept: NDArray[np.bool_]) -> ChannelFit:
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


def _range(channel: Channel, bench: Bench) -> float:
    """Size of what a channel measures; of the bus voltage where the channel measures zero."""
    largest = float(np.max(np.abs(channel.measured)))
    if largest == 0.0 and bench.bus_voltage is not None:
        largest = float(np.max(np.abs(bench.bus_voltage)))
    return max(largest, 1e-9)


def _at_edge(name: str, value: float, scale: float) -> bool:
    low, high = BOUNDS[name]
    lower_is_news = name in ("stator_resistance", "flux_linkage")
    return value > high - 1e-6 * (high - low) or (lower_is_news and value < low + 1e-6 * scale)
