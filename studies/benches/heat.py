"""Winding temperature: one node of ``sprintlab.motors.thermal`` fitted to one run, another run predicted.

Steady loss and heat capacity always come as a ratio: without a measured resistance the data tell only the
rise of temperature per ``A^2 s``, and the time constant. A second node (the motor's body) is fitted beside
it, to see what one node costs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sprintlab.motors.thermal import COPPER_COEFFICIENT
from studies.benches.data import FloatArray, columns

STEP = 1.0
"""Time between two records, and step of the integration [s]."""

AK_RUNS = {
    "AK10-9": ("ak109Run4Data", ("ak109Run1Data", "ak109Run2Data", "ak109Run3Data")),
    "AK60-6": ("ak606Run1Data", ("ak606Run2Data",)),
}
"""Run to identify on, runs to predict."""


@dataclass(frozen=True)
class Run:
    """One heating run, one row per second.

    Attributes:
        name: as printed.
        current: [A] ``(n,)``.
        temperature: measured [degC] ``(n,)``.
        ambient: [degC].
    """

    name: str
    current: FloatArray
    temperature: FloatArray
    ambient: float


def ak_run(folder: Path, name: str) -> Run:
    """A run of an AK motor; its currents are steps that the operator wrote down."""
    measured, asked = columns(folder, f"ak-{name}.csv"), columns(folder, f"ak-{name}-current.csv")
    time, temperature = measured["time [s]"], measured["temperature [degC]"]
    seconds = np.arange(0.0, time[-1] + STEP / 2.0, STEP)
    step = np.searchsorted(asked["until [s]"], seconds, side="right")
    return Run(
        name=name,
        current=asked["current [A]"][step],
        temperature=np.interp(seconds, time, temperature),
        ambient=float(asked["ambient [degC]"][0]),
    )


def simulated(parameters: Sequence[float], run: Run) -> FloatArray:
    """Temperature of the winding [degC] ``(n,)`` from the run's first one on.

    Args:
        parameters: rise per ``A^2 s`` at 20 degC [K/(A^2 s)], time constant to what lies outside [s]; with a
            second node also heat capacity of the body over the winding's, and the body's time constant [s].
        run: currents and surroundings.
    """
    gain, constant = parameters[0], parameters[1]
    winding, body = float(run.temperature[0]), float(run.temperature[0])
    found = np.empty(len(run.current))
    for index, current in enumerate(run.current.tolist()):
        found[index] = winding
        loss = gain * current**2 * (1.0 + COPPER_COEFFICIENT * (winding - 20.0))
        outside = body if len(parameters) > 2 else run.ambient
        flow = (winding - outside) / constant
        winding += STEP * (loss - flow)
        if len(parameters) > 2:
            body += STEP * (flow / parameters[2] - (body - run.ambient) / parameters[3])
    return found


def fitted(run: Run, nodes: int) -> FloatArray:
    """Parameters of ``simulated`` with one node or two, by least squares."""
    from scipy import optimize  # pyright: ignore[reportMissingTypeStubs]

    untyped: Any = optimize
    rise = float(np.ptp(run.temperature)) / max(float(np.sum(run.current**2)) * STEP, 1e-9)
    guess = (
        (np.log(rise), np.log(100.0))
        if nodes == 1
        else (np.log(2 * rise), np.log(40.0), np.log(4.0), np.log(500.0))
    )
    solution = untyped.least_squares(
        lambda logarithms: simulated(np.exp(logarithms).tolist(), run) - run.temperature,
        guess,
        bounds=(np.subtract(guess, 4.0), np.add(guess, 4.0)),
        loss="soft_l1",
    )
    return np.exp(np.asarray(solution.x))


def heat_rows(folder: Path) -> list[dict[str, Any]]:
    """Every motor, one node and two: identified on one run, errors on the others [K]."""
    cases = [
        (motor, ak_run(folder, known), [ak_run(folder, name) for name in held_out])
        for motor, (known, held_out) in AK_RUNS.items()
    ]
    return [_row(motor, known, held_out, nodes) for motor, known, held_out in cases for nodes in (1, 2)]


def _row(motor: str, known: Run, held_out: Sequence[Run], nodes: int) -> dict[str, Any]:
    parameters = fitted(known, nodes)
    return {
        "motor": motor,
        "nodes": nodes,
        "identified_on": known.name,
        "parameters": parameters.tolist(),
        "fit": _error(parameters, known),
        "held_out": {run.name: _error(parameters, run) for run in held_out},
    }


def _error(parameters: FloatArray, run: Run) -> dict[str, float]:
    error = simulated(parameters.tolist(), run) - run.temperature
    return {
        "rms": float(np.sqrt(np.mean(error**2))),
        "largest": float(np.max(np.abs(error))),
        "rise": float(np.max(run.temperature) - run.temperature[0]),
    }
