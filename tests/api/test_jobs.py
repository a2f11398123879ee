"""Trainings as processes: finished, failed, out of time, and taken up again."""

import math
import sys
import time

import pytest

from sprintlab.api.jobs import Job, run_jobs
from sprintlab.api.results import silent

TRAINING = """
import pathlib, signal, sys, time
folder, seconds = pathlib.Path(sys.argv[1]), float(sys.argv[2])
def save(*_):
    (folder / "checkpoint.pt").touch()
    sys.exit(143)
signal.signal(signal.SIGTERM, save)
(folder / "begun").touch()
time.sleep(0.0 if (folder / "checkpoint.pt").exists() else seconds)
(folder / "policy.onnx").touch()
"""


@pytest.fixture
def job(monkeypatch, tmp_path):
    def command(self, device):
        return [sys.executable, "-c", TRAINING, str(self.folder), *self.words]

    monkeypatch.setattr(Job, "command", command)
    return lambda name, seconds: Job(words=(seconds,), folder=tmp_path / name)


def test_a_list_is_worked_down_within_the_time_and_goes_on(job, tmp_path):
    jobs = [job("short", "0"), job("long", "60"), job("third", "0")]
    begun = time.monotonic()
    assert run_jobs(jobs[:2], ["cpu"], begun + 4.0, silent) == 1
    assert time.monotonic() - begun < 30.0 and (tmp_path / "long" / "checkpoint.pt").is_file()
    assert run_jobs(jobs, ["cpu"], time.monotonic() - 1.0, silent) == 1  # no time: nothing starts
    assert not (tmp_path / "third").exists()
    assert run_jobs(jobs, ["cpu", "cpu"], math.inf, silent) == 3


def test_a_failure_is_told_and_the_others_go_on(job, tmp_path, capsys):
    jobs = [job("broken", "no number"), job("good", "0")]
    assert run_jobs(jobs, ["cpu"], math.inf, silent) == 1
    assert "train.log" in capsys.readouterr().err
    assert "ValueError" in (tmp_path / "broken" / "train.log").read_text()


def test_a_training_that_has_a_checkpoint_is_resumed(tmp_path):
    job = Job(words=("bp2",), folder=tmp_path)
    assert "--resume" not in job.command("cpu")
    (tmp_path / "checkpoint.pt").touch()
    assert job.command("cuda:1")[-5:] == ["--device", "cuda:1", "--output", str(tmp_path), "--resume"]
