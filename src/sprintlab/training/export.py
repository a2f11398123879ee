"""From a checkpoint to one policy file: ONNX with the contract in its metadata, checked before it counts."""

from __future__ import annotations

import io
import tempfile
from pathlib import Path
from typing import Any

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
from sprintlab.robots import load_robot
from sprintlab.training.algorithm import build_actor
from sprintlab.training.networks import Actor
from sprintlab.training.runner import read_checkpoint
from sprintlab.training.settings import TrainingSettings

EXPORT_TOLERANCE = 1e-4
"""Greatest difference between the two runtimes that an export may show, on actions of order one."""


def actor_from_checkpoint(state: dict[str, Any]) -> Actor:
    """The actor with its weights, on the CPU, in evaluation mode."""
    settings: TrainingSettings = state["settings"]
    actor = build_actor(settings, load_robot(settings.robot))
    actor.load_state_dict(state["learner"]["actor"])
    return actor.eval()


def export_checkpoint(checkpoint: Path, output: Path) -> Path:
    """Write the policy of a checkpoint as ONNX; the file appears only if it reads back equal.

    Raises:
        SprintlabError: the checkpoint cannot be read, or the disk refuses.
        PolicyFileError: ONNX Runtime's actions differ from PyTorch's by more than ``EXPORT_TOLERANCE``.
    """
    state = read_checkpoint(checkpoint)
    actor = actor_from_checkpoint(state)
    input_size = state["settings"].observation.input_size
    data = _with_contract(_onnx_bytes(actor, input_size), state)
    _verify(data, actor, input_size)
    atomic_write_bytes(output, data)
    return output


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


def _with_contract(data: bytes, state: dict[str, Any]) -> bytes:
    settings: TrainingSettings = state["settings"]
    progress = state["progress"]
    record = TrainingRecord(
        method=settings.method,
        actuator_model=settings.actuator_model,
        command_line=state["command_line"],
        config_hash=settings.digest(),
        seed=settings.seed,
        iterations=progress.iteration,
        environment_steps=progress.environment_steps,
        device=state["device"],
        date=state["date"],
    )
    contract = make_contract(
        load_robot(settings.robot),
        layout=settings.observation,
        training=record,
        software=state["versions"],
        proprioception_filter=LowPass(),
        estimate_filter=LowPass(cutoff_hz=ESTIMATE_CUTOFF_HZ),
    )
    model = onnx.load_from_string(data)
    onnx.helper.set_model_props(model, {CONTRACT_KEY: encode_contract(contract)})
    return model.SerializeToString()


def _verify(data: bytes, network: Actor, input_size: int) -> None:
    """Read the file back through the runtime that will run it, and compare on random observations."""
    generator = np.random.default_rng(0)
    observations = generator.normal(size=(256, input_size)).astype(np.float32)
    estimates = generator.normal(size=(256, ESTIMATE_SIZE)).astype(np.float32)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "policy.onnx"
        path.write_bytes(data)
        written = load_policy(path).decide(observations, estimates)
    with torch.no_grad():
        meant = network(torch.from_numpy(observations), torch.from_numpy(estimates))
    for name, value, wanted in zip(("action", "estimate"), written, meant, strict=True):
        difference = float(np.abs(value - wanted.numpy()).max())
        if not difference <= EXPORT_TOLERANCE:
            raise PolicyFileError(
                f"the exported policy's {name} differs by {difference:.2e}, allowed {EXPORT_TOLERANCE:.0e}"
            )
