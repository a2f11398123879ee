"""Which law the data ask for, of saturation and of the gear's loss: held-out error and Akaike's criterion.

Each law is fitted by least squares to the rows that the identification kept, with the same friction beside
it. The criterion ``n ln(RSS / n) + 2 k`` counts parameters: a law is better by more than chance where it is
lower by ten.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from sprintlab.workbench.identification import Bench
from studies.benches.data import FloatArray, part
from studies.benches.predictions import PEAK_CURRENT, Split, accuracy, fitted

TURNING = 0.1
"""Joint speed over which the direction turns in the laws of the gear [rad/s]."""


@dataclass(frozen=True)
class Law:
    """A torque law.

    Attributes:
        name: as printed.
        torque: parameters, current [A], direction -1 to 1 -> torque [N m].
        guesses: first parameters, from several sides; the first is the torque constant over its guess.
        low, high: bounds.
    """

    name: str
    torque: Callable[[FloatArray, FloatArray, FloatArray], FloatArray]
    guesses: tuple[tuple[float, ...], ...]
    low: tuple[float, ...]
    high: tuple[float, ...]


def saturation_laws(constant: float, peak: float) -> tuple[Law, ...]:
    """Linear, the paper's quadratic one, a cubic one, and moteus's logarithmic one.

    moteus: ``tau = Kt I_c + s log2(1 + (I - I_c) c)`` above a current ``I_c``, ``Kt I`` below.
    """

    def linear(p: FloatArray, i: FloatArray, _: FloatArray) -> FloatArray:
        return p[0] * constant * i

    def quadratic(p: FloatArray, i: FloatArray, _: FloatArray) -> FloatArray:
        return p[0] * constant * i * (1.0 - p[1] * np.abs(i) / peak)

    def cubic(p: FloatArray, i: FloatArray, _: FloatArray) -> FloatArray:
        return p[0] * constant * i * (1.0 - p[1] * (i / peak) ** 2)

    def logarithmic(p: FloatArray, i: FloatArray, _: FloatArray) -> FloatArray:
        knee, size = p[1] * peak, np.abs(i)
        beyond = p[2] * constant * peak * np.log2(1.0 + np.maximum(size - knee, 0.0) * p[3] / peak)
        return np.sign(i) * (p[0] * constant * np.minimum(size, knee) + beyond)

    knees = tuple((1.0, knee, 0.5, 1.5) for knee in (0.02, 0.3, 0.6, 0.8))
    return (
        Law("linear", linear, ((1.0,),), (0.3,), (3.0,)),
        Law("quadratic (the paper)", quadratic, ((1.0, 0.15),), (0.3, -0.5), (3.0, 0.5)),
        Law("cubic", cubic, ((1.0, 0.15),), (0.3, -0.5), (3.0, 0.5)),
        Law("logarithmic (moteus)", logarithmic, knees, (0.3, 0.0, 0.01, 0.05), (3.0, 1.0, 5.0, 50.0)),
    )


def gear_laws(constant: float, peak: float) -> tuple[Law, ...]:
    """No loss with the load, our efficiency, the law of MuJoCo's issue 3528, and one efficiency each way.

    Issue 3528 takes ``mu_avg |tau| z + mu_dif tau z^2`` from the torque, with ``z`` the direction.
    """

    def motor(p: FloatArray, i: FloatArray) -> FloatArray:
        return p[0] * constant * i * (1.0 - p[1] * np.abs(i) / peak)

    def none(p: FloatArray, i: FloatArray, _: FloatArray) -> FloatArray:
        return motor(p, i)

    def ours(p: FloatArray, i: FloatArray, z: FloatArray) -> FloatArray:
        return motor(p, i) * p[2] ** (np.sign(i) * z)

    def issue(p: FloatArray, i: FloatArray, z: FloatArray) -> FloatArray:
        torque = motor(p, i)
        return torque - p[2] * np.abs(torque) * z - p[3] * torque * z**2

    def average(p: FloatArray, i: FloatArray, z: FloatArray) -> FloatArray:
        return motor(p, i) * (1.0 - p[2] * np.sign(i) * z)

    start, low, high = (1.0, 0.2), (0.3, -0.5), (3.0, 0.5)
    return (
        Law("none", none, (start,), low, high),
        Law("efficiency (ours)", ours, ((*start, 0.9),), (*low, 0.3), (*high, 1.2)),
        Law("mu_avg alone", average, ((*start, 0.1),), (*low, -0.5), (*high, 0.7)),
        Law("mu_avg and mu_dif", issue, ((*start, 0.1, 0.0),), (*low, -0.5, -0.5), (*high, 0.7, 0.5)),
    )


def behind_efficiency(laws: Sequence[Law]) -> tuple[Law, ...]:
    """The same laws of a motor behind a gear with our efficiency, fitted with them."""

    def geared(law: Law) -> Law:
        def torque(p: FloatArray, i: FloatArray, z: FloatArray) -> FloatArray:
            return law.torque(p[:-1], i, z) * p[-1] ** (np.sign(i) * z)

        guesses = tuple((*guess, 0.9) for guess in law.guesses)
        return Law(law.name, torque, guesses, (*law.low, 0.3), (*law.high, 1.2))

    return tuple(geared(law) for law in laws)


def compared_saturation(split: Split) -> dict[str, Any]:
    """The laws of saturation on one split; of a joint behind its gear's efficiency."""

    def laws(constant: float, peak: float) -> Sequence[Law]:
        found = saturation_laws(constant, peak)
        return behind_efficiency(found) if split.motor == "hej90" else found

    return compared(split, laws)


def compared(split: Split, laws: Callable[[float, float], Sequence[Law]] = gear_laws) -> dict[str, Any]:
    """Every law on one split: parameters, Akaike's criterion over the best, held-out error."""
    found = fitted(split.motor, split.known)
    kept = part(split.known, ~np.isin(split.known.lines, found.outliers))
    rows: dict[str, Any] = {}
    for law in laws(found.torque_constant, PEAK_CURRENT[split.motor]):
        parameters, residuals = _fitted(law, kept, split.scale)
        count, size = len(residuals), len(parameters)
        error = _residuals(parameters, law, split.held_out, split.scale)
        measured = split.held_out.torque * split.scale
        rows[law.name] = {
            "parameters": size,
            "law": parameters[: len(law.low)].tolist(),
            "criterion": count * math.log(float(np.mean(residuals**2))) + 2.0 * size,
            "error": accuracy(measured, measured + error),
        }
    best = min(row["criterion"] for row in rows.values())
    for row in rows.values():
        row["criterion_over_best"] = row.pop("criterion") - best
    return {"motor": split.motor, "split": split.name, "rows": kept.size, "laws": rows}


def _fitted(law: Law, bench: Bench, scale: float) -> tuple[FloatArray, FloatArray]:
    """Parameters, the friction's behind the law's, and residuals [N m] of the best of all guesses."""
    from scipy import optimize  # pyright: ignore[reportMissingTypeStubs]

    untyped: Any = optimize
    turns = bench.speed is not None and bool(np.any(np.abs(bench.speed) > 1.0))
    solutions = [
        untyped.least_squares(
            _residuals,
            (*guess, *((0.02, 0.02) if turns else ())),
            bounds=(
                (*law.low, *((-1.0, -1.0) if turns else ())),
                (*law.high, *((1.0, 1.0) if turns else ())),
            ),
            args=(law, bench, scale),
            x_scale="jac",
        )
        for guess in law.guesses
    ]
    best = min(solutions, key=lambda solution: solution.cost)
    return np.asarray(best.x), np.asarray(best.fun)


def _residuals(parameters: FloatArray, law: Law, bench: Bench, scale: float) -> FloatArray:
    """Predicted less measured torque on the printed side [N m]; both frictions in N m of the motor's side."""
    speed = np.zeros(bench.size) if bench.speed is None else bench.speed
    joint_speed = speed / scale
    direction = np.tanh(joint_speed / TURNING)
    torque = law.torque(parameters[: len(law.low)], bench.current, direction) * scale
    friction = parameters[len(law.low) :]
    if len(friction):
        fastest = max(float(np.max(np.abs(joint_speed))), 1e-9)
        torque = torque - scale * (friction[0] * direction + friction[1] * joint_speed / fastest)
    return torque - bench.torque * scale
