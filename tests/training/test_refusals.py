"""Bad input to ``sprintlab train``: one sentence, status 2, nothing trained."""

from pathlib import Path
from unittest.mock import Mock

import pytest

from sprintlab.cli.main import main
from sprintlab.core.errors import SprintlabError
from sprintlab.training.learner.distributed import Workers
from sprintlab.training.runs.options import TrainOptions
from sprintlab.training.runs.run import open_run, pick_device


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--seed", "-1"], "seed = -1"),
        (["--save-seconds", "nan"], "save_seconds = nan"),
        (["--device", "gpu7"], "device = 'gpu7' is not allowed: choose one of auto, cpu"),
        (["--device", "cuda:99"], "cuda:99"),
        (["--set", "ppo.stepps=3"], "ppo.stepps = 3 is not allowed: there is no such setting"),
    ],
)
def test_training_refuses_with_one_sentence(arguments, words, tmp_path, capsys):
    assert main(["train", "bp2", *arguments, "--output", str(tmp_path / "run")]) == 2
    said = capsys.readouterr().err.strip().splitlines()
    assert said[-1].startswith("sprintlab: ") and words in said[-1]
    assert not (tmp_path / "run" / "checkpoint.pt").exists()


def test_a_gpu_that_pytorch_cannot_use_is_no_reason_to_train_a_gpus_batch_on_the_cpu(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("sprintlab.training.runs.options._has_gpu", lambda: True)
    monkeypatch.setattr("torch.cuda.device_count", lambda: 0)
    with pytest.raises(SprintlabError, match=r"PyTorch sees 0 GPUs .* --device cpu"):
        pick_device(TrainOptions())
    assert pick_device(TrainOptions(device="cpu")) == "cpu"


@pytest.mark.parametrize(("device", "number"), [("cuda:1", 1), ("cuda", 0)])
def test_a_training_makes_its_gpu_the_current_one_before_anything_runs_on_it(
    device: str, number: int, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    happened: list[object] = []
    monkeypatch.setattr("torch.cuda.device_count", lambda: 2)
    monkeypatch.setattr("torch.cuda.set_device", happened.append)
    monkeypatch.setattr(
        "sprintlab.training.runs.run.Runner", lambda *given: happened.append(given[1]) or Mock()
    )
    open_run(TrainOptions(device=device, output=tmp_path), Workers())
    assert happened == [number, device]
