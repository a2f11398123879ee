"""Bad input to ``sprintlab train`` and ``learning``: one sentence, status 2, nothing trained."""

import importlib.util

import numpy as np
import pytest

from sprintlab.cli.main import main
from sprintlab.core.errors import InvalidValueError, UnwrittenError
from sprintlab.training.environment.randomization import friction
from sprintlab.training.terms import drawn


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--method", "nosuch"], "method = 'nosuch'"),
        (["--seed", "-1"], "seed = -1"),
        (["--save-seconds", "nan"], "save_seconds = nan"),
        (["--save-seconds", "-1"], "save_seconds = -1.0"),
        (["--device", "gpu7"], "device = 'gpu7' is not allowed: choose one of auto, cpu"),
        (["--device", "cuda:99"], "cuda:99"),
        (
            ["--set", "ppo.stepps=3"],
            "ppo.stepps = 3 is not allowed: there is no such setting, choose among steps",
        ),
        (["--settings", "nowhere.toml"], "cannot read settings nowhere.toml"),
    ],
)
def test_training_refuses_with_one_sentence(arguments, words, tmp_path, capsys):
    assert main(["train", "bp2", *arguments, "--output", str(tmp_path / "run")]) == 2
    said = capsys.readouterr().err.strip().splitlines()
    assert said[-1].startswith("sprintlab: ") and words in said[-1]
    assert not (tmp_path / "run" / "checkpoint.pt").exists()


@pytest.mark.parametrize("between", [(0.1, np.inf), (0.2, 0.1)])
def test_what_is_drawn_lies_between_two_ends(between):
    with pytest.raises(InvalidValueError, match="between"):
        drawn(friction, between=between)


@pytest.mark.skipif(importlib.util.find_spec("wandb") is not None, reason="wandb is installed here")
def test_a_missing_tracker_is_told_before_anything_is_prepared(tmp_path, capsys):
    assert main(["train", "bp2", "--wandb", "runs", "--output", str(tmp_path / "run")]) == 2
    assert capsys.readouterr().err.strip().endswith("pip install 'sprintlab[wandb]'")
    assert not (tmp_path / "run").exists()


def test_a_disk_that_is_full_from_the_start_promises_no_checkpoint(tmp_path, monkeypatch, capsys):
    def full(*_arguments):
        raise UnwrittenError("No space left on device")

    monkeypatch.setattr("sprintlab.training.runs.checkpoint.atomic_write_bytes", full)
    few = ["--set", "simulation.environments=2", "--iterations", "1", "--device", "cpu", "--plain"]
    assert main(["train", "bp2", *few, "--output", str(tmp_path)]) == 2
    said = capsys.readouterr().err.strip().splitlines()[-1]
    assert "stopped at iteration 1" in said and "there is no checkpoint yet" in said
