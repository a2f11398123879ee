"""The mean of several checkpoints is one policy, and says what it is made of."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("mujoco_warp")

import onnx
import torch
from onnx import numpy_helper

from sprintlab.control import load_policy
from sprintlab.control.pace import PaceContract
from sprintlab.control.turning import TurningContract
from sprintlab.core.errors import InvalidValueError, SprintlabError
from sprintlab.training.runs.averaging import average_checkpoints
from sprintlab.training.runs.checkpoint import read_checkpoint, write_checkpoint
from sprintlab.training.runs.export import export_checkpoint
from sprintlab.training.runs.runner import Runner
from sprintlab.training.settings import PpoSettings, SimulationSettings, TrainingSettings

SETTINGS = TrainingSettings(
    simulation=SimulationSettings(environments=2),
    ppo=PpoSettings(steps=2, epochs=1, mini_batches=1, hidden=(16, 8)),
)


def saved(folder: Path, name: str, settings: TrainingSettings) -> Path:
    """A checkpoint of networks that have not learned anything yet, its seed in the command line."""
    torch.manual_seed(settings.seed)
    path = folder / f"{name}.pt"
    Runner(settings, "cpu", f"train {name}").save(path, with_robots=False)
    return path


@pytest.fixture(scope="module")
def checkpoints(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    folder = tmp_path_factory.mktemp("averaging")
    return [saved(folder, name, replace(SETTINGS, seed=seed)) for seed, name in enumerate(("first", "last"))]


def initializers(path: Path) -> dict[str, np.ndarray]:
    return {tensor.name: numpy_helper.to_array(tensor) for tensor in onnx.load(path).graph.initializer}


def test_every_weight_is_the_mean(checkpoints: list[Path], tmp_path: Path) -> None:
    ends = [
        initializers(export_checkpoint(path, tmp_path / f"{path.stem}.onnx").path) for path in checkpoints
    ]
    mean = initializers(average_checkpoints(checkpoints, tmp_path / "mean.onnx").path)
    weights = [name for name, value in mean.items() if value.dtype == np.float32 and value.ndim == 2]
    assert len(weights) >= 6
    for name in weights:
        np.testing.assert_allclose(mean[name], (ends[0][name] + ends[1][name]) / 2.0, atol=1e-7)
        assert not np.allclose(mean[name], ends[0][name])


def test_shares_weigh_the_checkpoints(checkpoints: list[Path], tmp_path: Path) -> None:
    ends = [
        initializers(export_checkpoint(path, tmp_path / f"{path.stem}.onnx").path) for path in checkpoints
    ]
    mean = initializers(average_checkpoints(checkpoints, tmp_path / "mean.onnx", (1.0, 3.0)).path)
    for name in (name for name, value in mean.items() if value.dtype == np.float32 and value.ndim == 2):
        np.testing.assert_allclose(mean[name], 0.25 * ends[0][name] + 0.75 * ends[1][name], atol=1e-7)


@pytest.mark.parametrize("shares", [(1.0,), (1.0, 0.0), (1.0, float("nan"))])
def test_shares_that_are_not_one_for_each_are_refused(
    checkpoints: list[Path], tmp_path: Path, shares: tuple[float, ...]
) -> None:
    with pytest.raises(InvalidValueError, match="shares"):
        average_checkpoints(checkpoints, tmp_path / "mean.onnx", shares)


def test_the_contract_is_that_of_the_last(checkpoints: list[Path], tmp_path: Path) -> None:
    policy = load_policy(average_checkpoints(checkpoints, tmp_path / "mean.onnx").path)
    assert policy.contract.training is not None
    assert (policy.contract.training.command_line, policy.contract.training.seed) == ("train last", 1)


def test_the_contract_says_how_commands_reach_the_network_where_asked(
    checkpoints: list[Path], tmp_path: Path
) -> None:
    pace, turning = PaceContract(power=20.0), TurningContract(doubling_speed=8.0)
    path = average_checkpoints(checkpoints, tmp_path / "mean.onnx", pace=pace, turning=turning).path
    contract = load_policy(path).contract
    assert (contract.pace, contract.turning) == (pace, turning)
    contract = load_policy(average_checkpoints(checkpoints, path).path).contract
    assert (contract.pace, contract.turning) == (None, None)


def test_what_has_no_mean_is_refused_and_nothing_is_written(checkpoints: list[Path], tmp_path: Path) -> None:
    output = tmp_path / "mean.onnx"
    with pytest.raises(InvalidValueError, match="at least two"):
        average_checkpoints(checkpoints[:1], output)
    wider = saved(tmp_path, "wider", replace(SETTINGS, ppo=replace(SETTINGS.ppo, hidden=(32, 8))))
    with pytest.raises(SprintlabError, match="other networks"):
        average_checkpoints([wider, *checkpoints], output)
    assert not output.exists()


@pytest.mark.parametrize("weight", [3, "text", None])
def test_weights_that_are_no_tensors_are_refused(
    checkpoints: list[Path], tmp_path: Path, weight: object
) -> None:
    strange = tmp_path / "strange.pt"
    write_checkpoint({**read_checkpoint(checkpoints[0]), "learner": {"actor": {"w": weight}}}, strange)
    with pytest.raises(SprintlabError, match="not of the size"):
        average_checkpoints([strange, *checkpoints], tmp_path / "mean.onnx")
