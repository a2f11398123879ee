"""What a run shows: TensorBoard's curves, pictures and numbers."""

from __future__ import annotations

import importlib.machinery
import json
import sys
import types
from dataclasses import replace
from pathlib import Path

import matplotlib.image
import numpy as np
import pytest
import torch
from tensorboard.backend.event_processing import event_accumulator
from tests.training.small import small_settings

import sprintlab as sl
from sprintlab.cli.main import main
from sprintlab.commands import CommandGrid, UniformSchedule
from sprintlab.core.errors import SprintlabError
from sprintlab.training.runs.checkpoint import read_checkpoint, write_checkpoint
from sprintlab.training.runs.figures import grid_figure, learning_figures
from sprintlab.training.runs.progress import Board
from sprintlab.training.runs.run import TrainOptions, train
from sprintlab.training.runs.runner import Runner

TINY = small_settings()


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    torch.set_num_threads(1)
    folder = tmp_path_factory.mktemp("run")
    train(TrainOptions(output=folder, environments=8, iterations=3, device="cpu", settings=TINY))
    return folder


def test_curves_are_there(folder: Path) -> None:
    events = event_accumulator.EventAccumulator(str(folder / "tensorboard"))
    events.Reload()
    assert {"run/speed_p999", "run/grid_open", "run/falls", "loss/value"} <= set(events.Tags()["scalars"])


def test_the_command_says_how_far_the_run_has_come(folder: Path, tmp_path: Path, capsys) -> None:
    assert main(["learning", str(folder), "--output", str(tmp_path), "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert (said["iterations"], said["environment_steps"], said["broken_physics"]) == (3, 3 * 2 * 8, 0)
    assert said["figures"] == [str(tmp_path / f"{n}.png") for n in ("learning", "curriculum")]
    for name in said["figures"]:
        picture = matplotlib.image.imread(name)
        assert picture.shape[0] > 400 and picture.shape[1] > 500
        assert picture[..., :3].std() > 0.02, "an empty picture"
    found = sl.learning(folder, output=tmp_path)
    assert found.to_dict() == said
    assert "environment steps" in str(found) and str(folder / "checkpoint.pt") in str(found)
    assert main(["learning", str(tmp_path / "nothing")]) == 2
    assert "no such file" in capsys.readouterr().err


def test_what_has_no_curves_is_refused_in_a_sentence(folder: Path, tmp_path: Path, capsys) -> None:
    state = read_checkpoint(folder / "checkpoint.pt")
    milestone = {name: value for name, value in state.items() if name != "learner"}
    for wrong, words in (({**state, "growth": None}, "is damaged"), (milestone, "is a milestone")):
        write_checkpoint(wrong, tmp_path / "checkpoint.pt")
        assert main(["learning", str(tmp_path)]) == 2
        complaint = capsys.readouterr().err
        assert complaint.startswith("sprintlab: ") and complaint.count("\n") == 1 and words in complaint


def test_the_grid_is_drawn_as_it_is() -> None:
    grid = CommandGrid()
    weights = np.zeros((grid.rows, grid.yaw_bins))
    weights[:8] = 0.5
    axes = grid_figure(grid, weights, 3.0).axes[0]
    np.testing.assert_array_equal(axes.images[0].get_array(), weights)
    assert axes.get_ylim() == grid.speed
    assert axes.lines[0].get_ydata()[0] == 3.0
    assert axes.get_title(loc="left").startswith("25 %")


def test_a_schedule_without_grid_has_one_picture_less(tmp_path: Path) -> None:
    runner = Runner(replace(TINY, schedule=UniformSchedule()), "cpu", "plain")
    runner.iterate()
    assert [path.name for path in learning_figures(runner.state(), tmp_path)] == ["learning.png"]


def test_tensorboard_has_every_curve_and_a_resumed_run_replaces_lost_points(
    tmp_path: Path, monkeypatch
) -> None:
    monkeypatch.setattr("sprintlab.training.runs.progress.BOARD_SECONDS", 0.0)
    row = {"iteration": 1.0, "seconds": 0.1, "environment_steps": 16.0, "speed": 1.0, "loss/value": 2.0}
    killed = Board(tmp_path, 0)
    for iteration in range(1, 6):
        killed.add({**row, "iteration": float(iteration)})
    killed.close()
    resumed = Board(tmp_path, 3)
    resumed.add({**row, "iteration": 4.0, "speed": 9.0})
    resumed.close()
    events = event_accumulator.EventAccumulator(str(tmp_path))
    events.Reload()
    assert set(events.Tags()["scalars"]) == {"run/speed", "loss/value"}
    assert [(point.step, point.value) for point in events.Scalars("run/speed")] == [
        (1, 1.0), (2, 1.0), (3, 1.0), (4, 9.0),
    ]  # fmt: skip


def test_curves_that_the_disk_refuses_stop_training_with_one_sentence(tmp_path: Path, monkeypatch) -> None:
    board = Board(tmp_path, 0)

    def full(*_arguments) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(board._writer, "add_scalar", full)
    monkeypatch.setattr(board._writer, "close", full)
    with pytest.raises(SprintlabError, match="No space left on device"):
        board.add({"iteration": 7.0, "speed": 1.0})
    board.close()


def test_weights_and_biases_gets_what_tensorboard_gets(tmp_path: Path, monkeypatch) -> None:
    calls = []
    fake = types.ModuleType("wandb")
    fake.__spec__ = importlib.machinery.ModuleSpec("wandb", None)
    fake.init = lambda **words: calls.append(words)
    monkeypatch.setitem(sys.modules, "wandb", fake)
    options = TrainOptions(output=tmp_path, iterations=1, device="cpu", wandb="running", settings=TINY)
    train(options)
    begun = (tmp_path / "run.toml").read_text()
    train(replace(options, iterations=2, resume=True))
    assert (tmp_path / "run.toml").read_text() == begun
    assert [call["project"] for call in calls] == ["running"] * 2
    assert calls[0]["sync_tensorboard"] is True
    assert calls[0]["id"] == calls[1]["id"]
    assert calls[0]["config"]["ppo"]["steps"] == 2
    with pytest.raises(SprintlabError, match="without tensorboard"):
        replace(options, tensorboard=False)
