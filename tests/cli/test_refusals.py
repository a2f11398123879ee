"""What cannot work is refused before any work, in one sentence with status 2; nothing is left behind."""

from __future__ import annotations

import errno
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import sprintlab
from sprintlab.api.drive import DriveOptions
from sprintlab.motors import Battery, WindingHeat
from sprintlab.plant import PlantOptions

SOURCE, GO1 = Path(sprintlab.__file__).parents[1], Path(__file__).parents[2] / "examples" / "go1"
WITHOUT_TORCH = """
import contextlib, importlib.util, io, json, os, sys

class Refuse:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in ("torch", "warp", "mujoco_warp", "matplotlib"):
            raise SystemExit(f"imported {name}")

importlib.util.find_spec = lambda name, *rest: object()
sys.meta_path.insert(0, Refuse())
from sprintlab.cli.main import main

def answer(words):
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            status = main(words)
        except SystemExit as stop:
            status = stop.code
    return status, out.getvalue(), err.getvalue(), sorted(os.listdir())

print(json.dumps([answer(words) for words in json.load(sys.stdin)]))
"""
REFUSED = (
    ("train bp2 --method gallop", "method"),
    ("sweep s --methods sprinting --dry-run", "sprinting"),
    ("export junk.pt policy.onnx", "junk.pt"),
    ("race gallop", "gallop"),
    ("race broken.onnx", "damaged"),
    ("race other.onnx", "stiffness"),
    ("race lost.onnx", "lost.onnx is for robot 'mydog'"),
    ("race --robot half.toml", "half.toml"),
    ("race --output lost", "lost exists already"),
    ("evaluate sprint --battery --state-of-charge 50", "plant.state_of_charge"),
    ("turning sprint --speeds 99", "speeds"),
    ("lap sprint --top-speed 0.5", "top_speed"),
    ("motor envelope bp2 ankle", "knee"),
    ("motor show motor.toml", "bus_voltage is not given"),
    ("motor library --save x.toml", "name the actuator"),
    ("motor from-datasheet", "--template"),
    ("robot show spot", "bp2"),
    ("robot new none.xml --choices choices.toml", "cannot read robot model none.xml"),
    ("robot new go1.xml --choices choices.toml --name ../x", "name = '../x'"),
    ("robot new go1.xml --choices few.toml", "must be abad, hip, knee"),
    ("replay no-run", "no-run does not exist"),
    ("report none.mcap --output lost", "lost exists already"),
    ("run sprint shm://not-here", "no robot named 'not-here'"),
    ("run sprint http://bp2", "choose one of shm, unitree"),
    ("run --source profile:missing.csv", "missing.csv"),
    ("run --distance -1", "distance"),
    ("run --despite-audit slow", "--despite-audit names 'slow', but the policy is 'sprint'"),
    ("run sprint shm://not-here --log file", "exists already"),
)


@pytest.fixture(scope="module")
def refusals(tmp_path_factory, write_policy) -> dict[str, list[Any]]:
    """The folder's content and the answer to each command; PyTorch and matplotlib cannot be imported."""
    folder = tmp_path_factory.mktemp("typed")
    write_policy(folder / "other.onnx", stiffness=(20.0,) * 12)
    lost = write_policy(folder / "lost.onnx", robot_name="mydog")
    (folder / "broken.onnx").write_bytes(lost.read_bytes()[:-900])
    for name, text in {
        "junk.pt": "no checkpoint",
        "file": "",
        "few.toml": "bus_voltage = 24.0\n",
        "half.toml": 'name = "half"\n[body.total_mass]\nvalue = 3\n',
    }.items():
        (folder / name).write_text(text, encoding="utf-8")
    for name in ("go1.xml", "motor.toml", "choices.toml"):
        shutil.copy(GO1 / name, folder)
    (folder / "lost").symlink_to("nowhere")
    done = subprocess.run(
        [sys.executable, "-c", WITHOUT_TORCH],
        input=json.dumps([words.split() for words, _ in REFUSED]),
        cwd=folder,
        stdout=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONPATH": str(SOURCE)},
        check=True,
    )
    answers = zip(REFUSED, json.loads(done.stdout), strict=True)
    before = {*os.listdir(folder)} - {"runs"}
    return {words: [before, *answer] for (words, _), answer in answers}


@pytest.mark.parametrize(("words", "said"), REFUSED, ids=[words[:60] for words, _ in REFUSED])
def test_refused_before_any_work(refusals, words: str, said: str) -> None:
    before, status, out, err, after = refusals[words]
    sentence = err.splitlines()[-1]  # after remarks, as on what is simulated first
    assert (status, out) == (2, ""), err
    assert sentence.startswith("sprintlab: ") and said in sentence
    assert {*after} - {"runs"} == before


@pytest.mark.parametrize(
    ("command", "package", "extra"),
    [("train bp2", "torch", "train"), ("sweep runs", "torch", "train"), ("play", "viser", "play")],
)
def test_without_its_extra_a_command_says_how_to_install_it(
    call, monkeypatch, tmp_path, command, package, extra
):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    outcome = call(*command.split())
    assert outcome.status == 2 and f"package {package}" in outcome.err
    assert f"pip install 'sprintlab[{extra}]'" in outcome.err


def test_options_of_the_drive_turn_on_what_they_name(tmp_path):
    assert DriveOptions().plant() == PlantOptions() and DriveOptions().plant().remarks == ()
    plant = DriveOptions(motor_model="flux-weakening", battery=True, heat=True, state_of_charge=0.4).plant()
    assert (plant.motor_model, plant.battery, plant.state_of_charge) == ("flux-weakening", "robot", 0.4)
    assert plant.heat == WindingHeat() and len(plant.remarks) == 3
    (tmp_path / "pack.toml").write_text("[battery]\nseries_cells = 12\n")
    plant = DriveOptions(supply=tmp_path / "pack.toml", air="treadmill").plant()
    assert (plant.battery, plant.heat, plant.drag_area) == (Battery(series_cells=12), None, 0.0)


QUICK = ("--top-speed", 12, "--trials", 1, "--workers", 1, "--no-video")


def test_nan_in_a_trajectory(call, tmp_path, policy, computed):
    computed.raw.trials[0].trajectory.qvel[7, 1] = np.nan
    outcome = call("race", policy, "--output", tmp_path / "run", *QUICK)
    assert outcome.status == 2 and "no finite number" in outcome.err and "0.014 s" in outcome.err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.usefixtures("computed", "blank_pictures")
def test_the_numbers_of_a_race_are_not_lost_with_its_report(call, tmp_path, policy, monkeypatch):
    replace = os.replace

    def replace_or_fail(source, target):
        if str(target).endswith("speed.png"):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return replace(source, target)

    monkeypatch.setattr(os, "replace", replace_or_fail)
    outcome = call("race", policy, "--output", tmp_path / "run", *QUICK)
    assert "Exploit audit" in outcome.out and "report:" not in outcome.out
    assert outcome.status == 2 and "No space left" in outcome.err and "speed.png" in outcome.err
    assert list(tmp_path.iterdir()) == []
