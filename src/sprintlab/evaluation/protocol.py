"""The protocol that makes speeds comparable: seeded trials at each speed, and the search for the highest."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from sprintlab.core.checks import check_positive, check_range
from sprintlab.core.errors import InvalidValueError
from sprintlab.evaluation.pool import TrialPool
from sprintlab.evaluation.results import ProtocolResult, SpeedResult
from sprintlab.evaluation.trial import HIGHEST_SPEED, TrialRequest
from sprintlab.motors import WindingHeat
from sprintlab.plant import JOINT_NOISE, PlantOptions, TrialSettings

Progress = Callable[[SpeedResult], None]

FRICTION = (0.7, 1.0)
"""Range of the sliding friction of the seeded trials."""
PAYLOAD = 1.0
"""Half-width of the mass that they add to the trunk [kg]."""


@dataclass(frozen=True, kw_only=True)
class ProtocolSettings:
    """How the highest speed is searched.

    Raises:
        InvalidValueError: a field is out of range.
    """

    trials: int = 10  # seeded trials a speed
    required: int = 9  # how many must complete
    grid: float = 0.25  # step between speeds [m/s]
    first_step: float | None = None
    """Step of a first pass [m/s], a whole number of grid steps; the grid is then walked below the first speed
    at which too many trials fell, and below the first at which too many did not come to rest. ``None`` walks
    the whole grid. The two answers differ only where a policy fails at a speed between two of the first pass
    that it passes."""
    start: float = 1.0  # lowest speed [m/s]
    top: float = 16.0  # the search ends here even if every speed passed [m/s]
    hold: float = 10.0  # duration of the hold [s]
    seed: int = 0  # decides every trial's settings
    plant: PlantOptions = field(default_factory=PlantOptions)

    def __post_init__(self) -> None:
        check_range("protocol.trials", self.trials, 1, 10_000)
        check_range("protocol.required", self.required, 1, self.trials)
        check_range("protocol.grid", self.grid, 0.01, HIGHEST_SPEED, "m/s")
        steps = (self.first_step or self.grid) / self.grid
        if steps < 1.0 - 1e-9 or abs(steps - round(steps)) > 1e-6:
            allowed = f"a whole number of grid steps, {self.grid:g} m/s"
            raise InvalidValueError("protocol.first_step", self.first_step, allowed)
        check_positive("protocol.start", self.start, "m/s")
        check_range("protocol.top", self.top, self.start, HIGHEST_SPEED, "m/s")
        check_range("protocol.seed", self.seed, 0, 2**31)

    def speeds(self) -> tuple[float, ...]:
        """Every v* of the search, rising [m/s]."""
        count = int((self.top - self.start) / self.grid + 1e-9) + 1
        return tuple(self.start + self.grid * index for index in range(count))

    @property
    def stride(self) -> int:
        """Grid steps from one speed of the first pass to the next."""
        return round((self.first_step or self.grid) / self.grid)

    def trial_settings(self) -> tuple[TrialSettings, ...]:
        """Settings of the seeded trials: the same at every speed, for every policy."""
        return tuple(self._draw(self.seed + index) for index in range(self.trials))

    def _draw(self, seed: int) -> TrialSettings:
        random = np.random.default_rng((seed, 1))
        return TrialSettings(
            seed=seed,
            joint_noise=JOINT_NOISE,
            friction=float(random.uniform(*FRICTION)),
            payload=float(random.uniform(-PAYLOAD, PAYLOAD)),
        )

    def requests(self, top_speed: float, self_paced: bool) -> list[TrialRequest]:
        """The trials of one speed; the first one keeps its trajectory."""
        request = TrialRequest(top_speed=top_speed, self_paced=self_paced, hold=self.hold, plant=self.plant)
        drawn = enumerate(self.trial_settings())
        return [replace(request, settings=one, keep_trajectory=index == 0) for index, one in drawn]


def search_speeds(settings: ProtocolSettings, run: Callable[[float], SpeedResult]) -> tuple[SpeedResult, ...]:
    """Look for the highest speed that passes before the first at which too many trials fall.

    Running and stopping are two results: where a robot runs and does not come to rest the search goes on.

    Returns:
        What ``run``, which tries one speed [m/s], gave, by rising speed.
    """
    speeds = settings.speeds()
    first = _climb(range(0, len(speeds), settings.stride), speeds, run)
    reached = max((index for index, tried in first.items() if tried.ran), default=None)
    if reached is None:
        return tuple(first.values())
    failed = max(first) if max(first) > reached else len(speeds)
    tried = {**first, **_climb(range(reached + 1, failed), speeds, run)}
    restless = min((index for index, one in tried.items() if not one.passed), default=0)
    below = max((index for index in tried if index < restless), default=restless)
    tried |= _climb(range(below + 1, restless), speeds, run)
    return tuple(one for _, one in sorted(tried.items()))


def _climb(
    indices: range, speeds: tuple[float, ...], run: Callable[[float], SpeedResult]
) -> dict[int, SpeedResult]:
    """Try speeds in order up to the first at which too many trials fall."""
    tried: dict[int, SpeedResult] = {}
    for index in indices:
        tried[index] = run(speeds[index])
        if not tried[index].ran:
            break
    return tried


def run_speed(
    pool: TrialPool, top_speed: float, *, self_paced: bool, settings: ProtocolSettings | None = None
) -> SpeedResult:
    """The seeded trials of one v* [m/s], up to the fall that decides it; errors as in ``run_trial``."""
    settings = settings or ProtocolSettings()
    most_falls = settings.trials - settings.required
    trials = tuple(pool.trials(settings.requests(top_speed, self_paced), most_falls))
    required = min(settings.required, len(trials))
    return SpeedResult(top_speed=top_speed, self_paced=self_paced, trials=trials, required=required)


def run_protocol(
    pool: TrialPool,
    *,
    self_paced: bool,
    settings: ProtocolSettings | None = None,
    progress: Progress = lambda _: None,
) -> ProtocolResult:
    """Search the highest speed: rising v*, up to the first at which too many trials fall.

    ``progress`` is called with the result of every speed.

    Raises:
        SimulationError: as ``run_trial``.
    """
    settings = settings or ProtocolSettings()

    def run(top_speed: float) -> SpeedResult:
        result = run_speed(pool, top_speed, self_paced=self_paced, settings=settings)
        progress(result)
        return result

    return ProtocolResult(self_paced=self_paced, speeds=search_speeds(settings, run))


def run_protocol_near(near: float, pool: TrialPool, settings: ProtocolSettings) -> ProtocolResult:
    """The raw search of ``run_protocol``, begun at a speed that the policy likely holds [m/s].

    It begins at the lowest speed after all where a trial falls at that one, or does not come to rest.
    """
    begun = replace(settings, start=min(max(near, settings.start), settings.top))
    result = run_protocol(pool, self_paced=False, settings=begun)
    if (result.speeds[0].falls or not result.speeds[0].passed) and settings.start < begun.start:
        result = run_protocol(pool, self_paced=False, settings=settings)
    return result


def battery_request(top_speed: float, settings: ProtocolSettings) -> TrialRequest | None:
    """One nominal raw trial on a full battery with windings that warm up, to stand beside the stiff bus.

    ``None`` where the protocol itself has either.
    """
    plant = settings.plant
    if plant.battery is not None or plant.heat is not None:
        return None
    supplied = replace(plant, battery="robot", heat=WindingHeat())
    return TrialRequest(top_speed=top_speed, hold=settings.hold, plant=supplied)
