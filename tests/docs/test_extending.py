"""The examples of docs/extending.md: run as they stand, then looked at."""

import re
import sys
import types
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from sprintlab.commands import CommandStep, initial_state
from sprintlab.control import OBSERVABLES
from sprintlab.robots import load_robot

PAGE = Path(__file__).resolve().parents[2] / "docs" / "extending.md"


def examples():
    text = PAGE.read_text(encoding="utf-8")
    return dict(re.findall(r"^## ([^\n]+)\n.*?```python\n(.*?)```", text, re.MULTILINE | re.DOTALL))


@pytest.fixture
def example(tmp_path, monkeypatch):
    """Run the example below a heading in an empty folder; returns what it defined."""
    monkeypatch.chdir(tmp_path)

    def run(heading):
        names = {"__name__": "example"}
        exec(compile(examples()[heading], f"{PAGE.name}: {heading}", "exec"), names)
        return names

    return run


def test_power_limited_drive(example):
    names = example("A motor law")
    robot, given = names["robot"], names["given"]
    power = np.asarray(given.motor_torque) * 20.0 * np.asarray(robot.gear.ratio)
    assert power.max() <= 1500.0 * (1 + 1e-9)
    roomy = names["PowerLimitedDrive"](robot, robot.bus_voltage, 1e6)
    refined = names["PreparedDrive"](robot.motors, robot.gear, robot.bus_voltage)
    for speed in (-30.0, 0.0, 25.0):
        assert_allclose(roomy.limits(np.full(12, speed)), refined.limits(np.full(12, speed)))
    assert refined(np.full(12, 200.0), np.full(12, 20.0)).motor_torque.max() * 120.0 > 1500.0
    names["plant"].advance(robot.default_pose, 5)


def test_staircase_climbs_to_its_target(example):
    schedule = example("A command schedule")["StaircaseSchedule"]()
    count, random = 64, np.random.default_rng(0)
    state, before = initial_state(count, np.zeros(count)), np.zeros(count)
    for number in range(200):
        step = CommandStep(
            speed=np.zeros(count),
            dt=0.02,
            lower=-1.0,
            upper=4.0,
            friction=np.full(count, 0.8),
            reset_mask=np.full(count, number == 0),
            random=random.random((count, 8)),
        )
        state = schedule.advance(state, step)
        command = np.asarray(state.command[:, 0])
        assert np.abs(command - before).max() <= 0.5 + 1e-12
        assert command.min() >= -1.0 and command.max() <= 4.0
        before = command
    assert before.max() > 1.5


def test_an_observation_is_in_the_frame(example, monkeypatch):
    monkeypatch.setitem(OBSERVABLES, "turn", None)  # what the example puts there goes with the test
    assert example("An observation")["settings"].observation.for_joints(12).frame_size == 46


@pytest.mark.slow
@pytest.mark.usefixtures("brief_trials")
def test_what_is_ones_own_trains_exports_and_races(example, tmp_path, monkeypatch):
    """Schedule, reward term and robot in one training of two of it."""
    pytest.importorskip("torch")
    from sprintlab.api.evaluations import protocol_settings
    from sprintlab.api.training import train
    from sprintlab.evaluation.race import evaluate_race
    from sprintlab.training.runs.checkpoint import read_checkpoint

    names = example("A command schedule") | example("A reward term") | example("A robot")
    monkeypatch.setitem(sys.modules, "example", types.SimpleNamespace(**names))
    own = replace(names["settings"], schedule=names["StaircaseSchedule"](), robot="longshank")
    own = replace(own, ppo=replace(own.ppo, steps=2, mini_batches=1, epochs=1, hidden=(16,)))
    options = {"iterations": 1, "environments": 2, "device": "cpu", "fused": False, "plain": True}
    trained = train(own, output=tmp_path / "run", **options)
    kept = read_checkpoint(trained.checkpoint)
    assert kept["settings"].schedule == own.schedule and kept["settings"].reward == own.reward
    assert set(f"reward/{name}" for name in own.reward) <= set(kept["progress"].log[0])
    robot, brief = load_robot("longshank"), protocol_settings(1, 0)
    result = evaluate_race(trained.policy, robot, top_speed=0.5, distance=0.05, settings=brief, workers=1)
    assert result.robot == "longshank"
