"""Identify on one part of a bench, predict the part that the fit has not seen."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sprintlab.motors import PmsmParameters
from sprintlab.workbench.identification import Bench, Identification, identify
from studies.benches.data import HEJ90_RATIO, FloatArray, halves, joint, points, shaft

PEAK_CURRENT = {"ri50": 11.0, "d5065": 54.0, "hej90": 53.0}
"""Amplitude to which the saturation refers [A]: the largest of each bench."""

POLE_PAIRS = {"ri50": 7, "d5065": 7, "hej90": 1}
"""As the drives' files say; the joint's is not stated, and only its torque constant is used."""

STATED_CONSTANT = {"ri50": 0.1095229868838896, "d5065": 8.27 / 270.0}
"""Torque per ampere that the drive's calibration (RI50) and the motor's kV (D5065) promise [N m/A]."""

ALSO = {"ri50": (), "d5065": (), "hej90": ("gear_efficiency",)}
"""What is fitted beside the defaults: the HEJ-90 has a gear."""


@dataclass(frozen=True, kw_only=True)
class Split:
    """One part to identify on, one to predict; torques of a joint are printed on its side of the gear.

    With ``turning``, torque constant and saturation come from ``known``, a stalled motor, friction from it.
    """

    motor: str
    name: str
    known: Bench
    held_out: Bench
    turning: Bench | None = None

    @property
    def scale(self) -> float:
        """From the motor's torque to the printed one."""
        return HEJ90_RATIO if self.motor == "hej90" else 1.0


def splits(folder: Path) -> list[Split]:
    """Every split of the three motors."""
    return [*_ri50(folder), *_d5065(folder), *_hej90(folder)]


def fitted(motor: str, bench: Bench, turning: Bench | None = None) -> Identification:
    """What ``sprintlab motor identify`` finds; with ``turning``, friction alone from there."""
    given: Any = {"pole_pairs": POLE_PAIRS[motor], "peak_current": PEAK_CURRENT[motor], "also": ALSO[motor]}
    found = identify(bench, **given)
    if turning is None:
        return found
    base = PmsmParameters(
        pole_pairs=POLE_PAIRS[motor],
        stator_resistance=1.0,  # no voltage is predicted: these two play no part
        q_axis_inductance=1e-4,
        flux_linkage=found.estimates["flux_linkage"].value or 0.0,
        saturation=found.estimates["saturation"].value or 0.0,
        peak_torque=found.torque_constant * PEAK_CURRENT[motor],
        rotor_inertia=1e-5,
    )
    return identify(turning, base=base, hold=("flux_linkage", "saturation"), **given)


def accuracy(measured: FloatArray, predicted: FloatArray) -> dict[str, float]:
    """Errors of a prediction [N m], and their rms as a share of the largest torque."""
    error = predicted - measured
    largest = float(np.max(np.abs(measured)))
    rms = float(np.sqrt(np.mean(error**2)))
    return {
        "rows": len(error),
        "rms": rms,
        "share_of_largest": rms / largest,
        "median": float(np.median(np.abs(error))),
        "p95": float(np.quantile(np.abs(error), 0.95)),
        "bias": float(np.mean(error)),
        "largest_measured": largest,
    }


def predicted(split: Split) -> dict[str, Any]:
    """Parameters found on the known part, and how far they miss the held-out one."""
    found = fitted(split.motor, split.known, split.turning)
    held_out, scale = split.held_out, split.scale
    constant = STATED_CONSTANT.get(split.motor, _constant(split.known))
    return {
        "motor": split.motor,
        "split": split.name,
        "identified_on_rows": split.known.size,
        "parameters": _parameters(found, scale),
        "error": accuracy(held_out.torque * scale, found.torque(held_out) * scale),
        "error_of_constant": accuracy(held_out.torque * scale, constant * held_out.current * scale),
        "trustworthy": found.trustworthy,
        "warnings": list(found.warnings),
    }


def _parameters(found: Identification, scale: float) -> dict[str, Any]:
    """Torque constant and what else was fitted, with half widths of 95 % intervals, on the printed side."""
    flux = found.estimates["flux_linkage"]
    width = (flux.half_width or 0.0) / (flux.value or 1.0)
    units = {"coulomb_friction": scale, "viscous_friction": scale**2, "torque_offset": scale}
    told = {
        name: {
            "value": estimate.value * units.get(name, 1.0),
            "half_width": estimate.half_width * units.get(name, 1.0),
            "determined": estimate.determined,
        }
        for name, estimate in found.estimates.items()
        if estimate.value is not None and estimate.half_width is not None and name != "flux_linkage"
    }
    constant = found.torque_constant * scale
    return {"torque_constant": {"value": constant, "half_width": constant * width}, **told}


def _constant(bench: Bench) -> float:
    """Torque per ampere by least squares, with nothing else in the model."""
    return float(bench.current @ bench.torque / (bench.current @ bench.current))


def _ri50(folder: Path) -> list[Split]:
    found: list[Split] = []
    for motor in "12":
        stall = shaft(folder, f"stall-april-{motor}")
        time = np.asarray(stall.time)
        drives, brakes = (shaft(folder, f"damping-april-{motor}", role) for role in ("drives", "brakes"))
        parts = {
            "stalled, first half: second half": halves(stall, time < np.median(time)),
            "stalled, and driving: braking": (stall, brakes, drives),
            "stalled on 27 April: 13 May": (stall, shaft(folder, f"stall-13-may-{motor}")),
        }
        found += [_split("ri50", f"motor {motor}, {name}", *benches) for name, benches in parts.items()]
    return found


def _d5065(folder: Path) -> list[Split]:
    bench = points(folder)
    rules = {
        "odd rows: even rows": np.arange(bench.size) % 2 == 0,
        "below 200 rad/s: above": np.abs(np.asarray(bench.speed)) < 200.0,
        "up to 25 A: 25 to 54 A": np.abs(bench.current) < 25.0,
    }
    return [_split("d5065", name, *halves(bench, rule)) for name, rule in rules.items()]


def _hej90(folder: Path) -> list[Split]:
    known = joint(folder, "steps")
    others = {
        "steps of 140 N m": "steps-140",
        "torque of 42 sines to 25 Hz": "torque-sines-25-hz",
        "position of 42 sines to 10 Hz": "position-sines-10-hz",
    }
    return [
        _split("hej90", f"steps of 35 to 140 N m: {name}", known, joint(folder, file))
        for name, file in others.items()
    ]


def _split(motor: str, name: str, known: Bench, held_out: Bench, turning: Bench | None = None) -> Split:
    return Split(motor=motor, name=name, known=known, held_out=held_out, turning=turning)
