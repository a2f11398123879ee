"""The curves of a run: TensorBoard's, and what Weights & Biases gets of them."""

from __future__ import annotations

import importlib.machinery
import sys
import types
from dataclasses import replace
from pathlib import Path

import pytest
from tensorboard.backend.event_processing import event_accumulator
from tests.training.small import small_settings

from sprintlab.core.errors import SprintlabError
from sprintlab.training.runs.progress import Board
from sprintlab.training.runs.run import TrainOptions, train

TINY = small_settings()


def test_tensorboard_has_every_curve_and_a_resumed_run_replaces_lost_points(
    tmp_path: Path, monkeypatch
) -> None:
    monkeypatch.setattr("sprintlab.training.runs.progress.BOARD_SECONDS", 0.0)
    row = {"iteration": 1.0, "seconds": 0.1, "environment_steps": 16.0, "speed": 1.0, "loss/value": 2.0}
    killed = Board(tmp_path, "bp2", 0)
    for iteration in range(1, 6):
        killed.add({**row, "iteration": float(iteration)})
    killed.close()
    resumed = Board(tmp_path, "bp2", 3)
    resumed.add({**row, "iteration": 4.0, "speed": 9.0})
    resumed.close()
    events = event_accumulator.EventAccumulator(str(tmp_path / "tensorboard"))
    events.Reload()
    assert set(events.Tags()["scalars"]) == {"run/speed", "loss/value"}
    assert [(point.step, point.value) for point in events.Scalars("run/speed")] == [
        (1, 1.0), (2, 1.0), (3, 1.0), (4, 9.0),
    ]  # fmt: skip


def test_a_run_has_curves_and_weights_and_biases_gets_them(tmp_path: Path, monkeypatch) -> None:
    calls = []
    fake = types.ModuleType("wandb")
    fake.__spec__ = importlib.machinery.ModuleSpec("wandb", None)
    fake.init = lambda **words: calls.append(words)
    monkeypatch.setitem(sys.modules, "wandb", fake)
    options = TrainOptions(output=tmp_path, iterations=1, device="cpu", wandb="running", settings=TINY)
    train(options)
    events = event_accumulator.EventAccumulator(str(tmp_path / "tensorboard"))
    events.Reload()
    assert {"run/speed_p95", "run/grid_open", "run/falls", "loss/value"} <= set(events.Tags()["scalars"])
    begun = (tmp_path / "run.toml").read_text()
    train(replace(options, iterations=2, resume=True))
    assert (tmp_path / "run.toml").read_text() == begun
    assert [call["project"] for call in calls] == ["running"] * 2
    assert calls[0]["sync_tensorboard"] is True
    assert calls[0]["id"] == calls[1]["id"]
    assert calls[0]["config"]["ppo"]["steps"] == 2
    with pytest.raises(SprintlabError, match="curves that --plain leaves out"):
        replace(options, tensorboard=False)
