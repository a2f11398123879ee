"""Which speed a policy holds and estimates at every command, and tables that correct both.

The nominal robot stands, rises to a command and holds it, for one command after the other. The tables are
the measured speeds read the other way round: which command holds this speed, which speed belongs to this
estimate. Then the same commands run once more with the tables, and tell what they are worth.
"""

from __future__ import annotations

import copy
import math
import os
import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import msgspec

from sprintlab.commands import SpeedProfile
from sprintlab.control import (
    CONTRACT_KEY,
    Policy,
    PolicyContract,
    encode_contract,
    load_policy,
    read_again,
)
from sprintlab.control.calibration import CalibrationContract, given_speed
from sprintlab.control.pace import PaceContract
from sprintlab.control.policy_graph import with_metadata
from sprintlab.core.checks import check_range
from sprintlab.core.errors import PolicyFileError, SprintlabError, UnwrittenError
from sprintlab.core.files import atomic_write_bytes, numbered
from sprintlab.core.json_values import json_ready
from sprintlab.evaluation.estimates import estimate_pair
from sprintlab.evaluation.pool import TrialPool
from sprintlab.evaluation.results import Trajectory
from sprintlab.evaluation.trial import HIGHEST_SPEED, TrialRequest, run_course
from sprintlab.plant import BaseState
from sprintlab.robots import RobotDescription

STEP = 1.0
"""Between two commands of the ladder [m/s]."""
SMALL_ERROR = 0.1
"""Up to the first larger error nothing is corrected [m/s]."""
LEAST_GAIN = 0.25
"""Between two points of a table one side rises by no less than this share of the other's rise: where a policy
hardly gets faster, a table would make much of little."""
_SLOWEST_TOP = 2.0  # [m/s]
_SLOWEST_ESTIMATE = 1.0  # where a table of estimates may begin [m/s]

Pair = tuple[float, float]


@dataclass(frozen=True, kw_only=True)
class LadderSettings:
    """Which commands are run, and how long.

    Attributes:
        top_speed: greatest command [m/s]; those below it are every 1 m/s.
        hold: of each command [s].
        counted: last part of the hold, over which speeds are averaged [s].

    Raises:
        InvalidValueError: a number is out of range.
    """

    top_speed: float
    hold: float = 10.0
    counted: float = 4.0

    def __post_init__(self) -> None:
        check_range("calibrate.top_speed", self.top_speed, _SLOWEST_TOP, HIGHEST_SPEED, "m/s")
        check_range("calibrate.hold", self.hold, 0.5, 600.0, "s")
        check_range("calibrate.counted", self.counted, 0.1, self.hold, "s")

    @property
    def commands(self) -> tuple[float, ...]:
        """Rising, the top last [m/s]."""
        whole = (STEP * step for step in range(1, math.ceil(self.top_speed / STEP)))
        return (*whole, self.top_speed)


@dataclass(frozen=True, kw_only=True)
class Rung:
    """One command of the ladder; speeds are means over the last part of its hold.

    Attributes:
        command: [m/s]
        held: forward speed in the heading frame, as the protocol counts it [m/s].
        estimated: forward speed in the body frame, as ``PolicyRuntime.last_estimate`` tells it [m/s].
        true: the same, as the simulator knows it [m/s].
        fall: why the robot fell; empty where it did not, and nothing else counts where it did.
    """

    command: float
    held: float
    estimated: float
    true: float
    fall: str = ""

    @property
    def speed_error(self) -> float:
        """Held less commanded [m/s]."""
        return self.held - self.command

    @property
    def estimate_error(self) -> float:
        """Estimated less true [m/s]."""
        return self.estimated - self.true

    def to_dict(self) -> dict[str, Any]:
        """JSON-ready numbers."""
        return json_ready(
            {
                "command_m_s": self.command,
                "held_speed_m_s": self.held,
                "speed_error_m_s": self.speed_error,
                "estimated_speed_m_s": self.estimated,
                "estimate_error_m_s": self.estimate_error,
            }
        )


@dataclass(frozen=True, kw_only=True)
class CalibrationResult:
    """The tables of one policy, and what it does without and with them.

    Attributes:
        contract: the policy's own, with the tables and the lead.
        before: the ladder without any table.
        after: the same commands with the new contract.
    """

    contract: PolicyContract
    before: tuple[Rung, ...]
    after: tuple[Rung, ...]

    @property
    def tables(self) -> CalibrationContract:
        """The tables of the contract."""
        assert self.contract.calibration is not None
        return self.contract.calibration

    @property
    def fastest(self) -> float:
        """The fastest command that the tables say can be held [m/s]."""
        return self.tables.commanded[-1]

    def worst(self, rungs: Sequence[Rung]) -> tuple[float, float]:
        """Greatest errors of held speed, up to ``fastest``, and of the estimate [m/s]."""
        held = [abs(rung.speed_error) for rung in rungs if rung.command <= self.fastest]
        return max(held, default=math.nan), max(abs(rung.estimate_error) for rung in rungs)

    def given(self, command: float) -> float:
        """What the network is given for a command [m/s]."""
        return given_speed(self.tables, command)

    def to_dict(self) -> dict[str, Any]:
        """JSON-ready numbers."""
        (speed_before, estimate_before), (speed, estimate) = map(self.worst, (self.before, self.after))
        return json_ready(
            {
                "calibration": msgspec.to_builtins(self.tables),
                "fastest_command_held_m_s": self.fastest,
                "largest_speed_error_m_s": {"before": speed_before, "after": speed},
                "largest_estimate_error_m_s": {"before": estimate_before, "after": estimate},
                "before": [rung.to_dict() for rung in self.before],
                "after": [{"given_m_s": self.given(rung.command), **rung.to_dict()} for rung in self.after],
            }
        )


def calibrated(
    pool: TrialPool,
    settings: LadderSettings,
    lead: float | None = None,
    progress: Callable[[str, float], None] = lambda *_: None,
) -> CalibrationResult:
    """Measure a policy without any tables, make its tables, and measure it with them.

    Args:
        pool: policy, robot and processes.
        settings: the commands.
        lead: how far the forward command may run ahead of the calibrated estimate [m/s], as
            ``PaceContract.lead``; as the policy's contract says when left out.
        progress: called after every command with what is done and the share done.

    Raises:
        InvalidValueError: the lead is out of range.
        SprintlabError: the policy has no estimator, falls at a command, or hardly gets faster with it.
        SimulationError: as ``run_trial``.
    """
    if not pool.policy.estimates:
        raise SprintlabError("this policy has no estimator: there is no estimate of its speed to calibrate")
    own = pool.policy.contract
    pace = own.pace if lead is None else _led(own.pace, lead)
    plain = without_calibration(own)
    before = _ladder(pool, settings, plain, lambda what, share: progress(f"measuring {what}", share / 2))
    contract = msgspec.structs.replace(own, calibration=tables_of(before), pace=pace)
    after = _ladder(
        pool, settings, contract, lambda what, share: progress(f"checking {what}", (1 + share) / 2)
    )
    return CalibrationResult(contract=contract, before=before, after=after)


def without_calibration(contract: PolicyContract) -> PolicyContract:
    """The contract of the network by itself.

    Without the lead, too, which is that of the calibrated estimate: the network's own would hold the command
    back.
    """
    pace = contract.pace and _led(contract.pace, None)
    return msgspec.structs.replace(contract, calibration=None, pace=pace)


def _led(pace: PaceContract | None, lead: float | None) -> PaceContract:
    return PaceContract(lead=lead) if pace is None else msgspec.structs.replace(pace, lead=lead)


def tables_of(rungs: Sequence[Rung]) -> CalibrationContract:
    """The tables that a ladder gives.

    Up to the last command before the first error of more than ``SMALL_ERROR`` they change nothing. Above,
    each command is a point, except those that hold no more than a slower one does.

    Args:
        rungs: the commands rising.

    Raises:
        SprintlabError: the robot hardly runs faster, or estimates hardly more, at any faster command.
    """
    commanded, given = _table([(rung.held, rung.command) for rung in rungs], 0.0, "runs")
    estimated, true = _table([(rung.estimated, rung.true) for rung in rungs], _SLOWEST_ESTIMATE, "estimates")
    return CalibrationContract(commanded=commanded, given=given, estimated=estimated, true=true)


def _table(pairs: Sequence[Pair], slowest: float, what: str) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """The two rows of a table: an equal pair, then those that rise from there on."""
    first = next((place for place, (a, b) in enumerate(pairs) if abs(a - b) > SMALL_ERROR), len(pairs))
    first = min(first, len(pairs) - 1)  # one at least is corrected: a table has two points
    start = max(pairs[first - 1][1] if first else slowest, slowest)
    kept = [(start, start), *_rising((start, start), pairs[first:])]
    if len(kept) < 2:
        raise SprintlabError(
            f"nothing to calibrate: at no command the policy {what} much faster than {start:.1f} m/s"
        )
    places, values = zip(*kept, strict=True)
    return places, values


def _rising(last: Pair, pairs: Sequence[Pair]) -> Iterator[Pair]:
    """Those pairs of which both sides are well above the pair kept before."""
    for pair in pairs:
        rises = pair[0] - last[0], pair[1] - last[1]
        if min(rises) > 0.0 and min(rises) >= LEAST_GAIN * max(rises):
            last = pair
            yield pair


@dataclass(frozen=True, kw_only=True)
class _Hold:
    """The course of one command: as the protocol's profile, without its end."""

    profile: SpeedProfile

    @property
    def longest(self) -> float:
        return self.profile.hold_interval[1]

    def speed(self, time: float, base: BaseState) -> float | None:
        return float(self.profile.command(time)) if time < self.longest - 1e-9 else None


def _ladder(
    pool: TrialPool,
    settings: LadderSettings,
    contract: PolicyContract,
    progress: Callable[[str, float], None],
) -> tuple[Rung, ...]:
    commands, rungs = settings.commands, list[Rung]()
    climbed = pool.map(partial(climb, settings=settings, contract=contract), commands)
    for rung in climbed:
        if rung.fall:
            climbed.close()
            with_tables = "" if contract.calibration is None else "with its tables "
            raise SprintlabError(
                f"{with_tables}the policy falls ({rung.fall}) at {rung.command:g} m/s commanded: "
                "calibrate up to a lower --top-speed"
            )
        rungs.append(rung)
        progress(f"{rung.command:g} m/s", len(rungs) / len(commands))
    return tuple(rungs)


def climb(
    policy: Policy,
    robot: RobotDescription,
    command: float,
    settings: LadderSettings,
    contract: PolicyContract,
) -> Rung:
    """Run one command with this contract instead of the policy's own.

    Args:
        policy: with an estimator; it is left as it is.
        robot: nominal.
        command: [m/s]
        settings: of the hold.
        contract: the policy's, with other tables.

    Raises:
        SimulationError: as ``run_trial``.
    """
    changed = copy.copy(policy)
    changed.contract = contract
    course = _Hold(profile=SpeedProfile(top_speed=command, hold=settings.hold))
    trial = run_course(
        changed, robot, TrialRequest(top_speed=command, hold=settings.hold, keep_trajectory=True), course
    )
    if trial.fall_reason or trial.trajectory is None:
        return Rung(command=command, held=math.nan, estimated=math.nan, true=math.nan, fall=trial.fall_reason)
    return _means(command, trial.trajectory, settings.counted)


def _means(command: float, run: Trajectory, counted: float) -> Rung:
    """Means over the last part of a run [s]."""
    pair, start = estimate_pair(run), float(run.time[-1]) - counted
    late = pair.time >= start
    return Rung(
        command=command,
        held=float(run.velocity[run.time >= start, 0].mean()),
        estimated=float(pair.estimate[late, 0].mean()),
        true=float(pair.truth[late, 0].mean()),
    )


def write_calibrated(policy: Policy, path: Path, contract: PolicyContract, output: Path) -> Path:
    """Write a policy file with another contract; its network is the same to the last byte.

    Args:
        policy: that was measured.
        path: the file that it was read from.
        contract: its new one.
        output: the file to write; it appears only if it reads back as it was meant.

    Returns:
        The file that was written: beside ``output``, where something else has taken its name meanwhile.

    Raises:
        PolicyFileError: the file at ``path`` has changed, or the new one does not read back.
        UnwrittenError: the disk refuses.
    """
    data = with_metadata(read_again(path, policy), CONTRACT_KEY, encode_contract(contract))
    try:
        with tempfile.TemporaryDirectory() as folder:
            written = Path(folder) / "policy.onnx"
            atomic_write_bytes(written, data)
            if load_policy(written).contract != contract:
                raise PolicyFileError(f"the calibrated {path} does not read back as it was meant")
    except OSError as error:
        raise UnwrittenError(f"cannot write {output}: {error.strerror or error}") from error
    place = next(place for place in numbered(output, output.suffix) if not os.path.lexists(place))
    atomic_write_bytes(place, data)
    return place
