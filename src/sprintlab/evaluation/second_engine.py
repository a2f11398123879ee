"""The same policy in a second physics engine: what it says of a speed that the first one measured."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from sprintlab.control.policy import SHIPPED_POLICIES
from sprintlab.evaluation.protocol import ProtocolSettings
from sprintlab.evaluation.quantities import number
from sprintlab.evaluation.results import QUANTITIES, EngineResult, RaceResult, SpeedResult, SprintResult
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
"""A loss up to this is none, whatever its share [m/s]."""

STORED = SHIPPED_POLICIES / "second_engine.json"
"""What the policies of the package do in both engines, by the SHA-256 of their files."""


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


def first_engine(result: RaceResult) -> EngineResult:
    """What the race itself was run in, beside its second engine."""
    return EngineResult(engine=result.engine, sprint=result.sprint, raw=result.raw)


def engine_rows(first: EngineResult, second: EngineResult) -> Iterator[tuple[str, str, str, str]]:
    """Name, both values and unit of each number that both engines have."""
    distance = f"time over {first.sprint.distance:g} m"
    yield distance, _time(first.sprint), _time(second.sprint), "s"
    for item in QUANTITIES:
        values = [number(result.raw.mean(item.field), item.digits) for result in (first, second)]
        yield item.name, values[0], values[1], item.unit
    falls = [f"{result.raw.falls} of {len(result.raw.trials)}" for result in (first, second)]
    yield "falls", falls[0], falls[1], ""


def comparison_sentence(first: EngineResult, second: EngineResult) -> str:
    """What the second engine says, in one sentence."""
    name, other = ENGINE_NAMES[second.engine], ENGINE_NAMES[first.engine]
    held, change = second.raw.mean("held_speed"), speed_change(first.raw, second.raw)
    if not np.isfinite(held):
        return f"In {name}, the second engine, no trial was completed: the speeds are {other}'s alone."
    text = f"In {name}, the second engine, it holds {held:.2f} m/s"
    if np.isfinite(change):
        text += f", {abs(100 * change):.1f} % {'more' if change > 0 else 'less'} than in {other}"
    fault = mark(first.raw, second.raw)
    return f"{text}: {fault}." if fault else f"{text}."


def stored_comparison(digest: str) -> dict[str, Any] | None:
    """What was measured of this very policy file in both engines; ``None`` where nothing was.

    Args:
        digest: of the file that the policy was read from.
    """
    return json.loads(STORED.read_text(encoding="utf-8")).get(digest) if STORED.exists() else None


def stored_remark(digest: str) -> str:
    """The same as a sentence; empty where nothing is stored."""
    found = stored_comparison(digest)
    if found is None:
        return ""
    speeds = " and ".join(
        f"{_speed(found[engine])} in {ENGINE_NAMES[engine]}" for engine in ("mujoco", "drake")
    )
    text = f"two engines, stored, command up to {found['top_speed_command_m_s']:g} m/s: it holds {speeds}"
    return f"{text}; MARKED, in Drake {found['mark']}" if found["mark"] else text


def _time(sprint: SprintResult) -> str:
    return f"{sprint.time:.2f}" if sprint.finished else "not finished"


def _speed(numbers: dict[str, Any]) -> str:
    held = numbers["held_speed_m_s"]
    return "no speed (every trial fell)" if held is None else f"{held:.2f} m/s"
