"""Why a policy falls short of its command, and why its estimate errs: one cause taken away at a time.

    python benchmarks/shortfalls.py --workers 2          # writes results/sprint/shortfalls.json

One run a command and cause on the robot outdoors: one second of standing, a rise of 3 m/s², a hold of 8 s of
which the last 2 s count. ``CAUSES`` says what is taken away: a motor limit, the air, slip, noise, the error
of the estimate. What a cause costs is the speed that comes back without it. The tables that the policy's
contract may hold (``calibration``) are left out, and the lead with them: this is what the network does by
itself.

``sprint`` is a mean of two networks, one fifth ``fast`` and four fifths of one that is not kept. The second
follows from the two files, number by number. Both run alone as well, and read the speed from what ``sprint``
sees: is an error that of the mean, or of what was averaged?
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from harness import EVALUATION_PACKAGES, answer, circumstances
from numpy.typing import NDArray
from second_engine import digest, rounded

from sprintlab.api.policies import policy_path
from sprintlab.control import load_policy
from sprintlab.control.contract import robot_section
from sprintlab.control.filters import low_pass_coefficient
from sprintlab.control.policy import ESTIMATE_SIZE, Decision, Policy
from sprintlab.evaluation.calibration import without_calibration
from sprintlab.evaluation.estimates import estimate_pair
from sprintlab.evaluation.figures import on_envelope, recorded
from sprintlab.evaluation.results import Trajectory
from sprintlab.evaluation.trial import TrialRequest, run_course
from sprintlab.plant import BaseState, PlantOptions, TrialSettings
from sprintlab.robots import RobotDescription, load_robot

COMMANDS = (-5.0, -4.0, -3.0, -2.0, -1.0, 6.0, 8.0, 9.0, 10.0, 11.0, 12.0, 12.75, 13.25)
TESTED = (-2.0, 10.0, 11.0, 12.0)
"""Commands at which a line of the results page is missed [m/s]."""
STAND, RISE, HOLD, COUNTED = 1.0, 3.0, 8.0, 2.0
"""Standing [s], rise of the command [m/s²], hold and the last part of it that counts [s]."""
FAST, FAST_SHARE = Path("results/fifth-looks/fast.onnx"), 0.2
"""A network of the mean that is ``sprint``, and its share: ``results/seventh-looks/trainings.json``."""
Array = NDArray[np.floating[Any]]


@dataclass(frozen=True, kw_only=True)
class Cause:
    """What is changed to see what a cause costs.

    Attributes:
        plant: the simulated robot.
        trial: friction and noise.
        peak_torque: of each motor, over its own; what saturation takes at a torque stays as it is.
        estimate_error: of the forward speed, low-passed alike [m/s]; ``None`` leaves the estimate as it is.
        loops: whether pace and turning of the contract act.
    """

    plant: PlantOptions = field(default_factory=PlantOptions)
    trial: TrialSettings = field(default_factory=TrialSettings)
    peak_torque: float = 1.0
    estimate_error: float | None = None
    loops: bool = True


AS_EVALUATED = "as evaluated"
CAUSES = {
    AS_EVALUATED: Cause(),
    "no voltage limit": Cause(plant=PlantOptions(motor_model="square")),
    "peak torque 1.5 times": Cause(peak_torque=1.5),
    "estimate right": Cause(estimate_error=0.0),
    "estimate 1 m/s too low": Cause(estimate_error=-1.0),
    "no air": Cause(plant=PlantOptions(drag_area=0.0)),
    "friction 1.2": Cause(trial=TrialSettings(friction=1.2)),
    "friction 0.6": Cause(trial=TrialSettings(friction=0.6)),
    "sensor noise": Cause(trial=TrialSettings(sensor_noise=1.0)),
    "no pace, no turning loop": Cause(loops=False),
}


@dataclass
class Ramp:
    """Stand, rise, hold; a negative speed runs backward."""

    top: float
    base: BaseState | None = None

    @property
    def longest(self) -> float:
        """[s]"""
        return STAND + abs(self.top) / RISE + HOLD

    def speed(self, time: float, base: BaseState) -> float | None:
        """Asked for [m/s]; remembers where the robot is."""
        self.base = base
        if time >= self.longest - 1e-9:
            return None
        return float(np.sign(self.top) * np.clip(RISE * (time - STAND), 0.0, abs(self.top)))


class Watched:
    """The policy that it has, but it keeps what that saw and may set the error of its estimate."""

    def __init__(self, policy: Policy, ramp: Ramp, estimate_error: float | None = None) -> None:
        self.policy, self.ramp, self.error = policy, ramp, estimate_error
        self.seen: list[Array] = []
        self.true_speed = 0.0
        cutoff = policy.contract.filters.estimate_cutoff_hz
        self.newest = 1.0 if cutoff is None else low_pass_coefficient(cutoff, policy.contract.policy_rate_hz)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.policy, name)

    def decide(self, observation: Array, previous_estimate: Array | None = None) -> Decision:
        """As ``Policy.decide``."""
        self.seen.append(np.array(observation[0]))
        decision = self.policy.decide(observation, previous_estimate)
        if self.error is None or decision.estimate is None or self.ramp.base is None:
            return decision
        self.true_speed += self.newest * (self.ramp.base.forward_speed - self.true_speed)
        # The network filters inside: another previous estimate makes the new one what it shall be.
        moved = np.zeros((1, ESTIMATE_SIZE)) if previous_estimate is None else np.array(previous_estimate)
        moved[0, 0] += (self.true_speed + self.error - decision.estimate[0, 0]) / (1.0 - self.newest)
        return self.policy.decide(observation, moved)


@dataclass(frozen=True)
class Job:
    """One run: which file, which of ``CAUSES``, which command [m/s], and which files read beside it."""

    path: Path
    cause: str
    command: float
    readers: tuple[tuple[str, Path], ...] = ()

    def __call__(self) -> dict[str, Any]:
        """The row of this run."""
        cause, policy = CAUSES[self.cause], load_policy(self.path)
        robot = with_peak_torque(load_robot(policy.contract.robot_name), cause.peak_torque)
        changes = robot_section(robot) | ({} if cause.loops else {"pace": None, "turning": None})
        policy.contract = msgspec.structs.replace(without_calibration(policy.contract), **changes)
        ramp = Ramp(self.command)
        watched = Watched(policy, ramp, cause.estimate_error)
        request = TrialRequest(
            top_speed=abs(self.command), settings=cause.trial, plant=cause.plant, keep_trajectory=True
        )
        trial = run_course(watched, robot, request, ramp)  # pyright: ignore[reportArgumentType]
        run = recorded(trial)
        row = {"command_m_s": self.command, "fall": trial.fall_reason, **held(run, robot)}
        return rounded({**row, **readings(self.readers, watched, run)})


def with_peak_torque(robot: RobotDescription, factor: float) -> RobotDescription:
    """Motors with another peak torque; at any torque, saturation takes from it what it took before."""
    motors = robot.motors
    changes = {"peak_torque": factor * motors.peak_torque, "saturation": factor * motors.saturation}
    return robot if factor == 1.0 else replace(robot, motors=replace(motors, **changes))


def held(run: Trajectory, robot: RobotDescription) -> dict[str, float]:
    """Means over the part of the hold that counts."""
    last = run.time >= run.time[-1] - COUNTED
    pair = estimate_pair(run)
    late = pair.time >= pair.time[-1] - COUNTED
    error = pair.estimate[late, 0] - pair.truth[late, 0]
    return {
        "speed_m_s": float(run.velocity[last, 0].mean()),
        "most_limited_joint_share": float(on_envelope(run, robot)[last].mean(axis=0).max()),
        "stance_slip_m_s": float(run.foot_slip_speed[last][run.foot_contact[last]].mean()),
        "estimate_error_m_s": float(error.mean()),
    }


def readings(
    readers: tuple[tuple[str, Path], ...], watched: Watched, run: Trajectory
) -> dict[str, dict[str, float]]:
    """Errors of estimates that others make of the same inputs, unfiltered [m/s]."""
    if not readers:
        return {}
    steps = round(COUNTED * watched.policy.contract.policy_rate_hz)
    truth = estimate_pair(run).truth
    inputs = np.array(watched.seen[: len(truth)])[-steps:]
    estimates = {name: unfiltered(load_policy(path), inputs) for name, path in readers}
    errors = {name: float((read - truth[-steps:, 0]).mean()) for name, read in estimates.items()}
    blind = unfiltered(watched.policy, without_command(watched.policy, inputs))
    change = np.abs(blind - unfiltered(watched.policy, inputs)).max()
    return {"read_from_the_same_inputs": {**errors, "change without the command": float(change)}}


def unfiltered(policy: Policy, inputs: Array) -> Array:
    """Estimated forward speeds ``(N,)`` [m/s] of network inputs ``(N, H * F)``."""
    cutoff = policy.contract.filters.estimate_cutoff_hz
    estimate = policy.decide(inputs).estimate  # from a zero estimate: the filter passes its newest share
    assert cutoff is not None and estimate is not None
    return estimate[:, 0] / low_pass_coefficient(cutoff, policy.contract.policy_rate_hz)


def without_command(policy: Policy, inputs: Array) -> Array:
    """The inputs with every frame's command at zero."""
    frames = inputs.reshape(len(inputs), policy.layout.history_length, -1).copy()
    frames[..., policy.layout.place("command")] = 0.0
    return frames.reshape(inputs.shape)


def rest_of_mean(whole: Path, part: Path, share: float, output: Path) -> Path:
    """The network that makes ``whole``, together with ``share`` of ``part``."""
    import onnx
    from onnx import numpy_helper

    mean, known = onnx.load(whole), onnx.load(part)
    weights = {tensor.name: numpy_helper.to_array(tensor) for tensor in known.graph.initializer}
    for tensor in mean.graph.initializer:
        value = (numpy_helper.to_array(tensor) - share * weights[tensor.name]) / (1.0 - share)
        tensor.CopyFrom(numpy_helper.from_array(value.astype(np.float32), tensor.name))
    onnx.save(mean, output)
    return output


def measure(chosen: argparse.Namespace) -> dict[str, Any]:
    """All causes of one policy, and its networks where it is ``sprint``."""
    path = policy_path(chosen.policy)
    with tempfile.TemporaryDirectory() as folder, ProcessPoolExecutor(chosen.workers) as pool:
        networks = {}
        if chosen.policy == "sprint":
            rest = rest_of_mean(path, FAST, FAST_SHARE, Path(folder) / "rest.onnx")
            networks = {"fast": FAST, "the other network": rest}
        asked = list(jobs(path, networks, chosen.commands, chosen.tested))
        rows = pool.map(Job.__call__, [job for _, _, job in asked])
        found: dict[str, Any] = {"causes": {}, "networks": {}}
        for (group, name, _), row in zip(asked, rows, strict=True):
            found[group].setdefault(name, []).append(row)
    return {"policy": chosen.policy, "sha256": digest(path), **found, **circumstances(EVALUATION_PACKAGES)}


def jobs(
    path: Path, networks: dict[str, Path], commands: list[float], tested: list[float]
) -> Iterator[tuple[str, str, Job]]:
    """Group and name under which each run's row is kept, and the run."""
    readers = tuple(networks.items())
    for command in commands:
        yield "causes", AS_EVALUATED, Job(path, AS_EVALUATED, command, readers)
    for command in tested:
        for cause in CAUSES:
            if cause != AS_EVALUATED:
                yield "causes", cause, Job(path, cause, command)
    for name, network in readers:
        for command in (*tested, max(commands)):
            yield "networks", name, Job(network, AS_EVALUATED, command)


def parse() -> argparse.Namespace:
    """The arguments."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("policy", nargs="?", default="sprint", help="a file, or the name of a shipped one")
    parser.add_argument(
        "--commands", nargs="+", type=float, default=list(COMMANDS), help="as evaluated [m/s]"
    )
    parser.add_argument("--tested", nargs="+", type=float, default=list(TESTED), help="every cause [m/s]")
    parser.add_argument("--workers", type=int, default=1, help="processes")
    parser.add_argument("--output", type=Path, default=Path("results/sprint/shortfalls.json"))
    parser.add_argument("--json", action="store_true", help="print JSON only")
    return parser.parse_args()


def show(result: dict[str, Any]) -> None:
    """A line a run."""
    for group in ("causes", "networks"):
        for name, rows in result[group].items():
            for row in rows:
                print(f"{name}: {row}")


if __name__ == "__main__":
    raise SystemExit(answer(parse, measure, show))
