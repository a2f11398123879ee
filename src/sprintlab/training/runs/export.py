"""From a checkpoint to one policy file: ONNX with the contract in its metadata, checked before it counts."""

from __future__ import annotations

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
    TrainingRecord,
    encode_contract,
    load_policy,
    make_contract,
)
from sprintlab.control.filters import ESTIMATE_CUTOFF_HZ
from sprintlab.core.errors import PolicyFileError
from sprintlab.core.files import atomic_write_bytes
from sprintlab.core.reading import refused_as_damaged
from sprintlab.robots import RobotDescription, load_robot
from sprintlab.training.learner.algorithm import build_actor
from sprintlab.training.learner.networks import Actor
from sprintlab.training.runs.checkpoint import check_robot, read_checkpoint
from sprintlab.training.settings import TrainingSettings

EXPORT_TOLERANCE = 1e-4
"""Greatest difference between the two runtimes that an export may show, on actions of order one."""


def actor_from_checkpoint(state: dict[str, Any]) -> Actor:
    """The actor with its weights, on the CPU, in evaluation mode."""
    settings: TrainingSettings = state["settings"]
    actor = build_actor(settings, load_robot(settings.robot))
    with refused_as_damaged("the policy of this checkpoint", "is not of the size that its settings say"):
        actor.load_state_dict(state["policy"])
    return actor.eval()


class ExportedPolicy(NamedTuple):
    """A policy file, and the greatest difference of its actions and estimates from the network's."""

    path: Path
    difference: float


def export_checkpoint(checkpoint: Path, output: Path) -> ExportedPolicy:
    """Write the policy of a checkpoint as ONNX; the file appears only if it reads back equal.

    Raises:
        SprintlabError: the robot's table has changed since the training.
        PolicyFileError: ONNX Runtime and PyTorch differ by more than ``EXPORT_TOLERANCE`` on random inputs
            as the training has seen them.
    """
    state = read_checkpoint(checkpoint)
    actor, robot = actor_from_checkpoint(state), load_robot(state["settings"].robot)
    check_robot(state, robot)
    network = _onnx_bytes(actor, actor.history_length * actor.frame_size)
    data = _with_contract(network, state, robot)
    difference = _difference(data, actor, robot)
    atomic_write_bytes(output, data)
    return ExportedPolicy(output, difference)


def _onnx_bytes(network: torch.nn.Module, input_size: int) -> bytes:
    buffer = io.BytesIO()
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


def _with_contract(data: bytes, state: dict[str, Any], robot: RobotDescription) -> bytes:
    settings: TrainingSettings = state["settings"]
    record = TrainingRecord(
        method=settings.method,
        actuator_model=settings.actuator_model,
        seed=settings.seed,
        iterations=state["progress"].iteration,
        environment_steps=state["progress"].environment_steps,
        **{name: state[name] for name in ("command_line", "config_hash", "device", "date")},
    )
    contract = make_contract(
        robot,
        layout=settings.observation,
        training=record,
        software=state["versions"],
        proprioception_filter=LowPass(),
        estimate_filter=LowPass(cutoff_hz=ESTIMATE_CUTOFF_HZ),
    )
    model = onnx.load_from_string(data)
    onnx.helper.set_model_props(model, {CONTRACT_KEY: encode_contract(contract)})
    return model.SerializeToString()


@torch.no_grad()
def _difference(data: bytes, network: Actor, robot: RobotDescription) -> float:
    """Greatest difference between the file's network, in the runtime that drives robots, and PyTorch's."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "policy.onnx"
        atomic_write_bytes(path, data)
        policy = load_policy(path, robot)
    normalizer, generator = network.normalizer, torch.Generator().manual_seed(0)
    noise = torch.randn(256, network.history_length + 1, len(normalizer.mean), generator=generator)
    seen = normalizer.mean + normalizer.variance.sqrt() * noise
    size = network.frame_size
    inputs = seen[:, 1:, :size].flatten(1), seen[:, 0, size:]
    written = policy.decide(*(values.numpy() for values in inputs))
    differences = [0.0]
    for name, value, meant in zip(("action", "estimate"), written, network(*inputs), strict=True):
        differences.append(float("inf") if value is None else float(np.abs(value - meant.numpy()).max()))
        if not differences[-1] <= EXPORT_TOLERANCE:
            raise PolicyFileError(
                f"the policy file's {name} differs from the network's by {differences[-1]:.2e}, "
                f"allowed {EXPORT_TOLERANCE:.0e}"
            )
    return max(differences)
