"""Does a bench make sense before anything is fitted: enough points, signs, units that agree with each other.

The torque over the current and the back-EMF over the speed both give the flux linkage. A wrong unit, an rms
value or an electrical speed throws the two apart by a factor that names the mistake.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from sprintlab.core.array_types import FloatArray
from sprintlab.core.errors import SprintlabError
from sprintlab.workbench.identification.bench import Bench
from sprintlab.workbench.identification.model import directions, turns

_FEWEST_ROWS, _FEWEST_LEVELS = 8, 3  # rows, and different speeds and currents, that a bench needs
_SAME_LEVEL = 0.02  # share of the largest value within which two levels count as one
_AGREE = (0.93, 1.07)  # flux from torque over flux from voltage: beyond, a warning
_TOLERABLE = (0.8, 1.25)  # beyond, an error
_NAMED = 0.05  # a factor names a mistake if it is this near
_DEPENDENT = 0.03  # singular value of unit columns below which they count as dependent
_REACHED = (0.4, 1.25)  # amplitude over V_bus / sqrt(3) that an inverter gives at its limit: beyond, an error
_SAME_LIMIT = 0.1  # relative spread of that share among the rows that are marked
_OPPOSITE = -0.5  # correlation of v_d with -w i_q: below, one of the signs is wrong
_MOST_BACK_EMF = 1.3  # back-EMF over what the bus can balance, without flux weakening


def check_levels(bench: Bench) -> None:
    """Refuse benches with too few rows, speeds or currents to fit anything. Raises ``SprintlabError``."""
    if bench.size < _FEWEST_ROWS:
        raise SprintlabError(f"the bench has {bench.size} rows, at least {_FEWEST_ROWS} are needed")
    speed = bench.speed if bench.speed is not None and turns(bench) else None
    for name, values, unit in (("current", bench.current, "A"), ("speed", speed, "rad/s")):
        count = _FEWEST_LEVELS if values is None else _levels(values)
        if values is not None and count < _FEWEST_LEVELS:
            found = f"{count} different {name}{'' if count == 1 else 's'}"
            ends = f"{float(values.min()):.4g} to {float(values.max()):.4g} {unit}"
            raise SprintlabError(f"the bench has {found} ({ends}), at least {_FEWEST_LEVELS} are needed")


def _levels(values: FloatArray) -> int:
    """Number of different values, those within 2 % of the largest counted as one."""
    step = _SAME_LEVEL * float(np.max(np.abs(values)))
    count, last = 0, -math.inf
    for value in np.sort(values).tolist():
        if value - last > step:
            count, last = count + 1, value
    return count


def torque_flux(bench: Bench, pole_pairs: int) -> float:
    """Flux linkage from torque over current [Wb], saturation and friction taken off, robustly."""
    if float(np.median(np.abs(bench.torque))) == 0.0:
        raise SprintlabError("the torque is zero in most rows: is its column the right one?")
    columns = [bench.current, -bench.current * np.abs(bench.current)]
    friction = [] if bench.speed is None else [-directions(bench), -bench.speed]
    slope = float(bench.current @ bench.torque / (bench.current @ bench.current))
    for chosen in ([*columns, *friction], columns):  # the friction where it can be told apart
        slopes = _robust_slopes(np.stack(chosen, axis=-1), bench.torque)
        if slopes is not None:
            slope = float(slopes[0])
            break
    if slope <= 0.0:
        raise SprintlabError("torque and current have opposite signs: the bench must count driving positive")
    return slope / (1.5 * pole_pairs)


def voltage_flux(bench: Bench, pole_pairs: int) -> tuple[float, float] | None:
    """Flux linkage [Wb] and resistance [ohm] from v_q = R i_q + w psi, or the power over 1.5 i_q.

    ``None`` without voltages, or where the current follows the speed so that the two cannot be told apart.
    """
    if bench.speed is None or (bench.q_voltage is None and bench.power is None):
        return None
    design = np.stack((bench.current, pole_pairs * bench.speed), axis=-1)
    if bench.q_voltage is not None:
        slopes = _robust_slopes(design, bench.q_voltage)
    else:
        assert bench.power is not None
        slopes = _robust_slopes(design * bench.current[:, None], bench.power / 1.5)
    return None if slopes is None else (float(slopes[1]), float(slopes[0]))


def _robust_slopes(design: FloatArray, target: FloatArray) -> FloatArray | None:
    """Least squares, repeated without what lies far off, so that one spike does not decide.

    ``None`` where the columns depend on each other.
    """
    lengths = np.maximum(np.linalg.norm(design, axis=0), 1e-300)
    design = design / lengths
    if np.linalg.matrix_rank(design, tol=_DEPENDENT) < design.shape[1]:
        return None
    kept = np.ones(len(target), dtype=bool)
    slopes = np.zeros(design.shape[1])
    for _ in range(4):
        solution: Any = np.linalg.lstsq(design[kept], target[kept], rcond=None)
        slopes = np.asarray(solution[0], dtype=np.float64)
        error = np.abs(target - design @ slopes)
        kept = error <= 6.0 * float(np.median(error)) + 1e-12
    return slopes / lengths


def check_units(bench: Bench, pole_pairs: int) -> list[str]:
    """Compare what torque, current, speed and voltage say about the same flux.

    Returns:
        Warnings: what disagrees a little, and what nothing in the bench checks.

    Raises:
        SprintlabError: they disagree; the message names the mistakes that would explain it.
    """
    from_torque = torque_flux(bench, pole_pairs)
    from_voltage = voltage_flux(bench, pole_pairs)
    warnings: list[str] = []
    if from_voltage is not None:
        warnings = _compare_fluxes(from_torque, *from_voltage, pole_pairs)
        _check_direct_voltage(bench)
        warnings += _check_limited(bench)
    elif bench.speed is not None and bench.bus_voltage is not None:
        _check_back_emf(bench, from_torque, pole_pairs)
    if from_voltage is None or bench.q_voltage is None:
        warnings.append(_unchecked_scale(bench, from_torque, pole_pairs))
    return warnings


def _unchecked_scale(bench: Bench, flux: float, pole_pairs: int) -> str:
    """What a wrong gain of the current sensor, or a wrong unit, would do where v_q does not check it."""
    constant, kv = 1.5 * pole_pairs * flux, 60.0 / (2.0 * math.pi * math.sqrt(3.0) * pole_pairs * flux)
    if bench.speed is None:
        cause = "there are no speeds, so a unit of the torque or a gain of the current goes into the flux"
    elif bench.power is not None:
        cause = "k times too much current gives 1/k of the flux and 1/k^2 of the resistance"
    else:
        cause = "without v_q, k times too much current gives 1/k of the flux"
    return (
        f"this log cannot check the scale of current and torque: {cause}. Compare {constant:.4g} N m/A "
        f"(torque constant, amplitude; KV {kv:.4g} rpm/V, line-to-line amplitude) with the data sheet"
    )


def likely_mistakes(ratio: float, pole_pairs: int) -> list[str]:
    """Mistakes that multiply flux-from-torque over flux-from-voltage by about ``ratio``."""
    rpm = 60.0 / (2.0 * math.pi)
    known = [
        (rpm, "the speed is in rpm, its header says rad/s"),
        (1.0 / rpm, "the speed is in rad/s, its header says rpm"),
        (1e3, "the torque is in mN m, its header says N m"),
        (1e3, "the current is in A, its header says mA"),
        (1e-3, "the current is in mA, its header says A"),
        (1e-3, "the torque is in N m, its header says mN m"),
        (1e-3, "the voltages are in mV, their header says V"),
        (math.sqrt(2.0), "currents or voltages are rms values, amplitudes are needed"),
        (1.0 / math.sqrt(3.0), "the voltages are line-to-line, phase amplitudes are needed"),
        (1.0 / (2.0 * math.pi), "the speed is in revolutions per second, its header says rad/s"),
        (180.0 / math.pi, "the speed is in degrees per second, its header says rad/s"),
        (100.0, "the torque is in N cm, its header says N m"),
        (10.197, "the torque is in kgf cm, its header says N m"),
        (141.6, "the torque is in ounce-inches, its header says N m"),
        (2.0 / 3.0, "the dq quantities are power-invariant, amplitude-invariant ones are needed"),
        (float(pole_pairs), "the speed is electrical, the mechanical one is needed"),
    ]
    return [text for factor, text in known if abs(math.log(ratio / factor)) < _NAMED]


def _compare_fluxes(from_torque: float, from_voltage: float, resistance: float, pole_pairs: int) -> list[str]:
    if from_voltage <= 0:
        raise SprintlabError(
            f"v_q falls with speed (psi = {from_voltage:.3g} Wb): voltage and speed have opposite signs"
        )
    ratio = from_torque / from_voltage
    said = (
        f"torque over current gives psi = {from_torque * 1e3:.4g} mWb, "
        f"the back-EMF {from_voltage * 1e3:.4g} mWb (ratio {ratio:.3g})"
    )
    if not _TOLERABLE[0] <= ratio <= _TOLERABLE[1]:
        mistakes = likely_mistakes(ratio, pole_pairs)
        hint = " or ".join(mistakes) or "a unit, the pole pairs, or the side of a gear is wrong"
        raise SprintlabError(f"the bench contradicts itself: {said}: {hint}")
    warnings: list[str] = []
    if not _AGREE[0] <= ratio <= _AGREE[1]:
        warnings.append(f"{said}: check the gains of the sensors")
    if resistance < 0:
        warnings.append("v_q falls with current: check the sign of the current and of the speed")
    return warnings


def _check_direct_voltage(bench: Bench) -> None:
    """v_d = -w L i_q: refuse a bench where it goes the other way."""
    assert bench.speed is not None
    if bench.d_voltage is None:
        return
    expected = -bench.speed * bench.current
    size = float(np.linalg.norm(expected) * np.linalg.norm(bench.d_voltage))
    if size > 0.0 and float(expected @ bench.d_voltage) / size < _OPPOSITE:
        raise SprintlabError("v_d rises with speed times i_q, it must fall (v_d = -w L i_q): turn its sign")


def _check_limited(bench: Bench) -> list[str]:
    """Rows marked as limited must reach about the same share of the bus, one that inverters give."""
    if bench.bus_voltage is None or bench.q_voltage is None or bench.d_voltage is None:
        return []
    if not bench.limited.any():
        return []
    share = math.sqrt(3.0) * np.hypot(bench.q_voltage, bench.d_voltage) / bench.bus_voltage
    low, middle, high = np.quantile(share[bench.limited], (0.1, 0.5, 0.9)).tolist()
    if not _REACHED[0] <= middle <= _REACHED[1]:
        raise SprintlabError(
            f"the bench contradicts itself: on the rows marked limited the voltage is {middle:.3g} times "
            "bus_voltage / sqrt(3), which it should nearly reach: check the unit of bus_voltage"
        )
    if high - low > _SAME_LIMIT * middle:
        return [
            f"the rows marked limited reach {low:.2f} to {high:.2f} of bus_voltage / sqrt(3): mark only "
            "those where the inverter gives all its voltage"
        ]
    return []


def _check_back_emf(bench: Bench, flux: float, pole_pairs: int) -> None:
    """Without voltages: the back-EMF must not exceed what the bus can balance."""
    assert bench.bus_voltage is not None
    if bench.speed is None or float(bench.d_current.min()) < -0.01 * float(np.max(np.abs(bench.current))):
        return
    driving = bench.speed * bench.current >= 0.0  # braking, the resistive drop takes part of the back-EMF
    if not driving.any():
        return
    share = (np.abs(bench.speed) * pole_pairs * flux * math.sqrt(3.0) / bench.bus_voltage)[driving]
    most = float(np.quantile(share, 0.95))
    if most > _MOST_BACK_EMF:
        mistakes = likely_mistakes(most, pole_pairs)
        hint = " or ".join(mistakes) or "is the speed in rpm, the torque in mN m, or the current in rms?"
        raise SprintlabError(
            f"the bench contradicts itself: torque over current gives psi = {flux * 1e3:.4g} mWb, "
            f"whose back-EMF is {most:.3g} times what the bus can balance at the highest speeds: {hint}"
        )
