"""From a checkpoint to one policy file: ONNX with the contract in its metadata, checked before it counts."""

from __future__ import annotations

import copy
import io
import tempfile
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import onnx
import torch

from sprintlab.control import (
    CONTRACT_KEY,
    ESTIMATE_SIZE,
    LowPass,
    Policy,
    TrainingRecord,
    encode_contract,
    load_policy,
    make_contract,
)
from sprintlab.control.filters import ESTIMATE_CUTOFF_HZ
from sprintlab.control.pace import PaceContract
from sprintlab.control.turning import TurningContract
from sprintlab.core.errors import PolicyFileError, SprintlabError
from sprintlab.core.files import atomic_write_bytes
from sprintlab.robots import RobotDescription, load_robot
from sprintlab.training.learner.algorithm import build_actor
from sprintlab.training.learner.networks import Actor, trim
from sprintlab.training.runs.checkpoint import check_robot, read_checkpoint
from sprintlab.training.runs.observed_run import ObservedRun, observe_run
from sprintlab.training.settings import TrainingSettings

EXPORT_TOLERANCE = 1e-4
"""Greatest difference between the two runtimes that an export may show, on actions of order one."""


def actor_from_checkpoint(state: dict[str, Any]) -> Actor:
    """The actor with its weights, on the CPU, in evaluation mode.

    Raises:
        SprintlabError: weights and settings do not fit each other.
    """
    settings: TrainingSettings = state["settings"]
    robot, weights = load_robot(settings.robot), state["policy"]
    try:
        actor = build_actor(settings, robot)
        actor.load_state_dict(weights)
    except (RuntimeError, TypeError) as error:
        raise SprintlabError(
            "the policy of this checkpoint is not of the size that its settings say"
        ) from error
    return actor.eval()


class ExportedPolicy(NamedTuple):
    """A policy file, and how it was checked.

    Attributes:
        path: of the file.
        replayed: policy steps of a run that went through both runtimes.
        difference: greatest difference between their actions or estimates, on that run and random inputs.
    """

    path: Path
    replayed: int
    difference: float


def export_checkpoint(
    checkpoint: Path,
    output: Path,
    pace: PaceContract | None = None,
    turning: TurningContract | None = None,
) -> ExportedPolicy:
    """Write the policy of a checkpoint as ONNX; the file appears only if it reads back equal.

    It is read back and runs four seconds in the plant, and both runtimes are compared on that run: ONNX
    Runtime with the observation, filters and history that drive robots, and PyTorch on what the network was
    given at each step.

    Args:
        checkpoint: of a training run.
        output: the file to write.
        pace: how far the forward command that reaches the network may run ahead of the robot, and how fast
            it may fall; as it is given when left out.
        turning: which yaw rate the network is asked for; the one that is commanded when left out.

    Raises:
        SprintlabError: the checkpoint cannot be read, its robot's table has changed, or the disk refuses.
        PolicyFileError: the runtimes differ by more than ``EXPORT_TOLERANCE``.
    """
    return export_state(read_checkpoint(checkpoint), output, pace, turning)


def export_state(
    state: dict[str, Any],
    output: Path,
    pace: PaceContract | None = None,
    turning: TurningContract | None = None,
) -> ExportedPolicy:
    """``export_checkpoint`` of what was read, or made of several that were; raises what that does."""
    actor = actor_from_checkpoint(state)
    settings: TrainingSettings = state["settings"]
    network = _onnx_bytes(actor, settings.observation.for_joints(len(actor.std)).input_size)
    data = _with_contract(network, state, pace, turning)
    replayed, difference = _verify(data, actor, load_robot(settings.robot))
    atomic_write_bytes(output, data)
    return ExportedPolicy(output, replayed, difference)


def _onnx_bytes(network: torch.nn.Module, input_size: int) -> bytes:
    network, buffer = copy.deepcopy(network), io.BytesIO()
    trim(network)
    names = ["observation", "previous_estimate", "action", "estimate"]
    torch.onnx.export(
        network,
        (torch.zeros(1, input_size), torch.zeros(1, ESTIMATE_SIZE)),
        buffer,  # pyright: ignore[reportArgumentType]  # torch's annotation omits what dynamo=False accepts
        input_names=names[:2],
        output_names=names[2:],
        dynamic_axes={name: {0: "batch"} for name in names},
        opset_version=17,
        dynamo=False,
    )
    return buffer.getvalue()


def _with_contract(
    data: bytes, state: dict[str, Any], pace: PaceContract | None, turning: TurningContract | None
) -> bytes:
    settings: TrainingSettings = state["settings"]
    progress = state["progress"]
    record = TrainingRecord(
        method=settings.method,
        actuator_model=settings.actuator_model,
        command_line=state["command_line"],
        config_hash=state["config_hash"],
        seed=settings.seed,
        iterations=progress.iteration,
        environment_steps=progress.environment_steps,
        device=state["device"],
        date=state["date"],
    )
    robot = load_robot(settings.robot)
    check_robot(state, robot)
    contract = make_contract(
        robot,
        layout=settings.observation,
        training=record,
        software=state["versions"],
        proprioception_filter=LowPass(),
        estimate_filter=LowPass(cutoff_hz=ESTIMATE_CUTOFF_HZ),
        pace=pace,
        turning=turning,
    )
    model = onnx.load_from_string(data)
    onnx.helper.set_model_props(model, {CONTRACT_KEY: encode_contract(contract)})
    return model.SerializeToString()


def _verify(data: bytes, network: Actor, robot: RobotDescription) -> tuple[int, float]:
    """Read the file back through the runtime that will run it, and compare on a run and on random inputs."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "policy.onnx"
        atomic_write_bytes(path, data)
        policy = load_policy(path, robot)
    seen = observe_run(policy, robot)
    return len(seen.action), max(_compare(network, seen), _compare(network, _random_inputs(policy)))


def _random_inputs(policy: Policy) -> ObservedRun:
    generator = np.random.default_rng(0)
    observations = generator.normal(size=(256, policy.layout.input_size)).astype(np.float32)
    estimates = generator.normal(size=(256, ESTIMATE_SIZE)).astype(np.float32)
    return ObservedRun(observations, estimates, *policy.decide(observations, estimates))


def _compare(network: Actor, written: ObservedRun) -> float:
    """Greatest difference between what the file's network said and what PyTorch says to the same inputs."""
    with torch.no_grad():
        meant = network(torch.from_numpy(written.observation), torch.from_numpy(written.previous_estimate))
    differences = [0.0]
    for name, value, wanted in zip(
        ("action", "estimate"), (written.action, written.estimate), meant, strict=True
    ):
        difference = float("inf") if value is None else float(np.abs(value - wanted.numpy()).max())
        if not difference <= EXPORT_TOLERANCE:
            raise PolicyFileError(
                f"the policy file's {name} differs from the network's by {difference:.2e}, "
                f"allowed {EXPORT_TOLERANCE:.0e}"
            )
        differences.append(difference)
    return max(differences)
