"""Bad input to ``sprintlab train`` and ``learning``: one sentence, status 2, nothing trained."""

import importlib.util
import sys

import numpy as np
import pytest

pytest.importorskip("torch")
pytest.importorskip("rsl_rl")
pytest.importorskip("torch")

from sprintlab.cli.main import main
from sprintlab.core.errors import InvalidValueError, SprintlabError
from sprintlab.training.environment.randomization import friction
from sprintlab.training.learner.distributed import Workers
from sprintlab.training.runs import run as run_module
from sprintlab.training.runs.options import check_places
from sprintlab.training.runs.run import TrainOptions, open_run, train
from sprintlab.training.settings import TrainingSettings
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
        (["--set", "ppo.stepps=3"], "did you mean ppo.steps?"),
        (["--settings", "nowhere.toml"], "cannot read settings nowhere.toml"),
        (["--resume"], "there is nothing to resume"),
    ],
)
def test_training_refuses_with_one_sentence(arguments, words, tmp_path, capsys):
    assert main(["train", "bp2", *arguments, "--output", str(tmp_path / "run")]) == 2
    said = capsys.readouterr().err.strip().splitlines()
    assert said[-1].startswith("sprintlab: ") and words in said[-1]
    assert not (tmp_path / "run" / "checkpoint.pt").exists()


@pytest.mark.parametrize("name", ["milestones", "tensorboard", "wandb", ".wandb"])
@pytest.mark.parametrize("kind", ["link", "dangling", "file"])
def test_what_leads_a_run_out_of_its_folder_is_refused(name, kind, tmp_path):
    """The folder of a run may come from a stranger, with a link to a folder of one's own in it."""
    place, elsewhere = tmp_path / "run" / name, tmp_path / "elsewhere"
    place.parent.mkdir()
    if kind == "file":
        place.write_text("mine")
    else:
        place.symlink_to(elsewhere)
    if kind == "link":
        elsewhere.mkdir()
    with pytest.raises(SprintlabError, match=f"{name} is no folder of the run"):
        check_places(TrainOptions(output=tmp_path / "run", device="cpu"))
    assert not elsewhere.exists() or not list(elsewhere.iterdir())


def test_a_run_removes_only_what_its_own_killed_writes_left(tmp_path, monkeypatch):
    """A folder ended it with Python's words; an editor's .run.toml.swp, with what was typed, was deleted."""
    ours, editors = tmp_path / ".checkpoint.pt.a_0z9b1c", tmp_path / ".run.toml.swp"
    kept = tmp_path / ".run.toml.original"
    for file in (ours, editors, kept):
        file.write_text("half")
        file.chmod(0o600 if file == ours else 0o644)
    folder = tmp_path / ".checkpoint.pt.abcdefgh"
    folder.mkdir()

    def begun(*_arguments):
        raise SprintlabError("begun")

    monkeypatch.setattr(run_module, "open_run", begun)
    with pytest.raises(SprintlabError, match="begun"):
        train(TrainOptions(output=tmp_path, device="cpu"))
    assert editors.exists() and folder.is_dir() and not ours.exists()
    assert kept.exists() or sys.platform == "win32"


@pytest.mark.parametrize("folder", ["wandb", ".wandb"])
def test_a_strangers_folder_does_not_say_where_curves_are_sent(folder, tmp_path, monkeypatch):
    """wandb sent the account's key to the base_url of the file, and ran what .git/config there named."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / folder).mkdir()
    (tmp_path / folder / "settings").write_text("[default]\nbase_url = http://192.0.2.1\nsave_code = true\n")
    check_places(TrainOptions(output=tmp_path / "run", device="cpu"))
    with pytest.raises(SprintlabError, match=f"{folder}/settings in the working folder"):
        check_places(TrainOptions(output=tmp_path / "run", device="cpu", wandb="speed"))


@pytest.mark.parametrize("between", [(0.1, np.inf), (0.2, 0.1)])
def test_what_is_drawn_lies_between_two_ends(between):
    with pytest.raises(InvalidValueError, match="between"):
        drawn(friction, between=between)


@pytest.mark.skipif(importlib.util.find_spec("wandb") is not None, reason="wandb is installed here")
def test_a_missing_tracker_is_told_before_anything_is_prepared(tmp_path, capsys):
    assert main(["train", "bp2", "--wandb", "runs", "--output", str(tmp_path / "run")]) == 2
    assert capsys.readouterr().err.strip().endswith("pip install 'sprintlab[wandb]'")
    assert not (tmp_path / "run").exists()


def test_a_milestone_has_no_learning_curve(tmp_path, capsys):
    options = TrainOptions(environments=2, device="cpu", output=tmp_path, settings=TrainingSettings())
    open_run(options, Workers()).save_policy(tmp_path / "0001.pt")
    capsys.readouterr()
    assert main(["learning", str(tmp_path / "0001.pt"), "--json"]) == 2
    captured = capsys.readouterr()
    assert captured.out == "" and "is a milestone" in captured.err


def test_a_disk_that_is_full_from_the_start_promises_no_checkpoint(tmp_path, monkeypatch, capsys):
    def full(*_arguments):
        raise SprintlabError("No space left on device")

    monkeypatch.setattr("sprintlab.training.runs.checkpoint.atomic_write_bytes", full)
    few = ["--set", "simulation.environments=2", "--iterations", "1", "--device", "cpu", "--no-tensorboard"]
    assert main(["train", "bp2", *few, "--output", str(tmp_path)]) == 2
    said = capsys.readouterr().err.strip().splitlines()[-1]
    assert "stopped at iteration 1" in said and "there is no checkpoint yet" in said
