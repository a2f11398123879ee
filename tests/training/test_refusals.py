"""Bad input to ``sprintlab train``: one sentence, status 2, nothing trained."""

import pytest

from sprintlab.cli.main import main


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
