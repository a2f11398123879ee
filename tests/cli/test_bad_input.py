"""Bad input: one sentence on stderr, a non-zero status, nothing half-written."""

import errno
import os
from pathlib import Path

import numpy as np
import pytest

from sprintlab.cli import main as entry

QUICK = ("--top-speed", 12, "--trials", 1, "--workers", 1, "--no-video")


def assert_refused(outcome, *words):
    """One sentence on stderr, status 2, nothing on stdout."""
    assert outcome.status == 2
    assert outcome.out == ""
    assert len(outcome.err.strip().splitlines()) == 1
    assert outcome.err.startswith("sprintlab: ")
    for word in words:
        assert word in outcome.err


def test_missing_policy(call, tmp_path):
    assert_refused(
        call("race", tmp_path / "none.onnx", "--output", tmp_path / "run"), "none.onnx", "No such file"
    )
    assert list(tmp_path.iterdir()) == []


def test_unknown_shipped_policy(call):
    assert_refused(call("race", "no-such-policy"), "no-such-policy")
    assert_refused(call("race", "gallop"), "gallop", "sprint")


def test_truncated_policy(call, tmp_path, policy):
    broken = tmp_path / "broken.onnx"
    broken.write_bytes(policy.read_bytes()[:-900])
    assert_refused(call("race", broken, "--output", tmp_path / "run"), "broken.onnx", "damaged")
    assert not (tmp_path / "run").exists()


def test_foreign_policy(call, tmp_path, write_policy):
    foreign = write_policy(tmp_path / "foreign.onnx", with_contract=False)
    assert_refused(call("evaluate", foreign), "not a sprintlab policy")


@pytest.mark.parametrize("command", ["race", "evaluate"])
def test_contract_of_another_robot(call, tmp_path, write_policy, command):
    other = write_policy(tmp_path / "other.onnx", stiffness=(20.0,) * 12)
    assert_refused(call(command, other, "--output", tmp_path / "run"), "stiffness")
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize("command", ["race", "evaluate", "play", "run"])
def test_policy_for_a_robot_that_is_not_known(call, tmp_path, write_policy, command):
    other = write_policy(tmp_path / "other.onnx", robot_name="mydog")
    assert_refused(call(command, other), "other.onnx", "'mydog'", "--robot")


@pytest.mark.parametrize("command", ["race", "evaluate"])
def test_policy_of_another_robot_than_the_one_asked_for(call, command):
    assert_refused(call(command, "go1-sprint", "--robot", "bp2"), "robot_name differs", "'go1'", "'bp2'")


def test_robot_file_that_is_no_robot(call, tmp_path, policy):
    table = tmp_path / "robot.toml"
    table.write_text('name = "half"\n[body.total_mass]\nvalue = 3\n')
    assert_refused(call("race", policy, "--robot", table, "--output", tmp_path / "run"), "robot.toml")
    assert not (tmp_path / "run").exists()


def test_robot_that_does_not_compile(call, tmp_path, policy, monkeypatch):
    def refuse(*_):
        raise ValueError("mass and inertia of moving bodies must be larger than mjMINVAL")

    monkeypatch.setattr("mujoco.MjSpec.compile", refuse)
    outcome = call("race", policy, "--output", tmp_path / "run", *QUICK)
    assert_refused(outcome, "mjMINVAL")
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize(
    "flag", [("--trials", 0), ("--workers", 0), ("--top-speed", -1), ("--top-speed", "nan")]
)
def test_numbers_out_of_range(call, tmp_path, policy, flag):
    assert_refused(call("race", policy, "--output", tmp_path / "run", *flag), "is not allowed")
    assert not (tmp_path / "run").exists()


def test_a_result_folder_is_never_overwritten(call, tmp_path, policy):
    (tmp_path / "notes.txt").write_text("mine")
    assert_refused(call("race", policy, "--output", tmp_path), "exists already")
    assert (tmp_path / "notes.txt").read_text() == "mine"


def test_nan_in_a_trajectory(call, tmp_path, policy, computed):
    computed.raw.trials[0].trajectory.qvel[7, 1] = np.nan
    outcome = call("race", policy, "--output", tmp_path / "run", *QUICK)
    assert_refused(outcome, "qvel", "no finite number", "0.014 s")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("file", ["trajectory.npz", "speed.png"])
@pytest.mark.usefixtures("computed", "blank_pictures")
def test_full_disk(call, tmp_path, policy, monkeypatch, file):
    def full():
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    save, replace = np.savez_compressed, os.replace

    def save_or_fail(path, **arrays):
        return full() if str(path).endswith(file) else save(path, **arrays)

    def replace_or_fail(source, target):
        return full() if str(target).endswith(file) else replace(source, target)

    monkeypatch.setattr(np, "savez_compressed", save_or_fail)
    monkeypatch.setattr(os, "replace", replace_or_fail)
    outcome = call("race", policy, "--output", tmp_path / "run", *QUICK)
    assert "Exploit audit" in outcome.out and "report:" not in outcome.out, "its numbers are printed"
    assert_refused(outcome._replace(out=""), "No space left", file)
    assert list(tmp_path.iterdir()) == []


def test_unknown_method(call):
    pytest.importorskip("torch")
    assert_refused(call("train", "no-such-method"), "no-such-method", "sprint")


def test_training_without_its_packages(call, monkeypatch):
    monkeypatch.setattr("sprintlab.api.training.NEEDED", ("no_such_package",))
    assert_refused(call("train", "sprint"), "pip install 'sprintlab[train]'")


def test_checkpoint_that_is_not_there(call, tmp_path):
    assert_refused(call("export", tmp_path / "none.pt", tmp_path / "out.onnx"), "none.pt")
    assert list(tmp_path.iterdir()) == []


def test_unknown_robot_and_joint(call):
    assert_refused(call("robot", "show", "spot"), "spot", "bp2")
    assert_refused(call("motor", "envelope", "bp2", "ankle"), "ankle", "knee")
    assert_refused(call("motor", "envelope", "bp2", "hip", "--bus-voltage", -4), "bus_voltage")


def test_motor_file_with_an_impossible_value(call, tmp_path):
    path = tmp_path / "motor.toml"
    path.write_text("[motor]\npole_pairs = 21\nstator_resistance = -1.0\n")
    assert_refused(call("motor", "show", path), "motor.toml")


def test_an_interruption_ends_with_130(call, monkeypatch):
    def interrupt(_):
        raise KeyboardInterrupt

    monkeypatch.setattr(entry, "run", interrupt)
    outcome = call("race")
    assert outcome.status == 130 and outcome.err == "sprintlab: interrupted\n"


@pytest.mark.parametrize(
    "kind", ["pipe", "link to itself", "file", "folder of others", "study that tells nothing"]
)
def test_a_place_that_is_no_folder_of_sprints_is_refused_before_the_search_for_a_speed(
    call, tmp_path, monkeypatch, kind
):
    monkeypatch.setattr("sprintlab.api.robustness._search", lambda *_: pytest.fail("it searched"))
    place = tmp_path / "place"
    make = {"pipe": os.mkfifo, "link to itself": lambda link: link.symlink_to(link), "file": Path.touch}
    make.get(kind, Path.mkdir)(place)
    if kind == "folder of others":
        (place / "other").touch()
    elif kind == "study that tells nothing":
        (place / "study.json").write_text("[]")
    assert_refused(call("robustness", "--output", place), "place", "another")
