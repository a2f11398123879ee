"""The same policy in a second physics engine: what it says of a speed that the first one measured."""

from __future__ import annotations

from dataclasses import replace

from sprintlab.evaluation.protocol import ProtocolSettings
from sprintlab.evaluation.results import SpeedResult
from sprintlab.evaluation.trial import TrialRequest
from sprintlab.plant import DRAKE_TIMESTEP, on_engine

ENGINE_NAMES = {"mujoco": "MuJoCo", "drake": "Drake"}
ENGINE_STEPS = {
    "mujoco": "MuJoCo C, 0.25 ms steps",
    "drake": f"Drake, {1e3 * DRAKE_TIMESTEP:g} ms steps, the same pads",
}

LARGEST_LOSS = 0.10
"""Share of the held speed that a policy may lose in the second engine without a mark: engines with the same
numbers and motor law, but with dynamics and time stepping of their own, should agree better than this."""

SMALLEST_LOSS = 0.1
"""A loss up to this counts as zero, whatever its share [m/s]."""


def engine_requests(
    top_speed: float, distance: float, settings: ProtocolSettings, engine: str
) -> tuple[TrialRequest, ...]:
    """The sprint and the raw trials of a race in another engine, with the same draws.

    Raises:
        SprintlabError: the engine is not installed.
    """
    plant = on_engine(settings.plant, engine)
    sprint = TrialRequest(top_speed=top_speed, distance=distance, plant=plant)
    return sprint, *replace(settings, plant=plant).requests(top_speed, False)


def speed_change(first: SpeedResult, second: SpeedResult) -> float:
    """Held speed in the second engine over the first, minus one; ``nan`` where either is undefined."""
    before, after = first.mean("held_speed"), second.mean("held_speed")
    return after / before - 1.0 if before > 0.0 else float("nan")


def mark(first: SpeedResult, second: SpeedResult) -> str:
    """What is to be said against a speed in view of the second engine; empty where nothing is."""
    lost = -speed_change(first, second)
    slower = first.mean("held_speed") - second.mean("held_speed")
    faults = []
    if second.falls > first.falls:
        faults.append(f"{second.falls} of {len(second.trials)} trials fell")
    if lost > LARGEST_LOSS and slower > SMALLEST_LOSS:
        faults.append(f"it holds {100 * lost:.0f} % less speed")
    return " and ".join(faults)
