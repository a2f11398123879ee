"""The examples of docs/extending.md: run as they stand, then looked at."""

import re
import sys
import types
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

PAGE = Path(__file__).resolve().parents[2] / "docs" / "extending.md"
LONGEST = 40  # lines


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


def test_the_examples_are_short():
    names = ["A motor law", "A command schedule", "A reward term", "An observation", "A robot"]
    assert list(examples()) == names
    assert max(len(code.splitlines()) for code in examples().values()) < LONGEST


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
    names["plant"].advance(robot.default_pose, 5, _Idle())


class _Idle:
    """A recorder that keeps nothing."""

    def sample(self, data, drive, targets):
        pass

    def watch_step(self, data):
        pass


def test_staircase_climbs_to_its_target(example):
    from sprintlab.commands import CommandStep, initial_state

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


def test_reward_term_stands_in_the_run(example):
    torch = pytest.importorskip("torch")
    added = example("A reward term")["settings"].reward["sideways_velocity"]
    assert added.weights == (-0.5, -2.0)

    class Step:
        class body:
            velocity = torch.tensor([[3.0, -2.0, 0.0]])

    assert added.function(Step, **added.parameters).tolist() == [4.0]


def test_an_observation_is_in_the_frame(example, monkeypatch):
    from sprintlab.control import OBSERVABLES

    monkeypatch.setitem(OBSERVABLES, "turn", None)  # what the example puts there goes with the test
    assert example("An observation")["settings"].observation.for_joints(12).frame_size == 46


def test_long_shank_is_a_robot(example):
    from sprintlab.robots import load_robot, robot_names

    names = example("A robot")
    assert "longshank" in robot_names()
    assert names["robot"].standing_height > load_robot("bp2").standing_height
    assert names["model"].nu == 12


def _through(settings, folder):
    """Train an iteration, export, race a step; returns the result and the settings as they were kept."""
    from dataclasses import replace

    from sprintlab.api.evaluations import protocol_settings
    from sprintlab.api.training import train
    from sprintlab.evaluation.race import evaluate_race
    from sprintlab.robots import load_robot
    from sprintlab.training.runs.checkpoint import read_checkpoint

    tiny = replace(settings.ppo, steps=2, mini_batches=1, epochs=1, hidden=(16,))
    settings = replace(settings, ppo=tiny)
    trained = train(
        settings,
        output=folder / "run",
        iterations=1,
        environments=2,
        device="cpu",
        fused=False,
        plain=True,
    )
    result = evaluate_race(
        trained.policy,
        load_robot(settings.robot),
        top_speed=0.5,
        distance=0.05,
        settings=protocol_settings(1, 0),
        workers=1,
    )
    return result, read_checkpoint(trained.checkpoint)


def _training():
    pytest.importorskip("mujoco_warp")
    from sprintlab.training.settings import TrainingSettings

    return TrainingSettings


@pytest.mark.slow
@pytest.mark.usefixtures("brief_trials")
def test_a_schedule_of_ones_own_trains_exports_and_races(example, tmp_path, monkeypatch):
    names = example("A command schedule")
    monkeypatch.setitem(sys.modules, "example", types.SimpleNamespace(**names))
    result, kept = _through(_training()(schedule=names["StaircaseSchedule"]()), tmp_path)
    assert result.robot == "bp2" and kept["settings"].schedule == names["StaircaseSchedule"]()


@pytest.mark.slow
@pytest.mark.usefixtures("brief_trials")
def test_a_reward_of_ones_own_trains_exports_and_races(example, tmp_path, monkeypatch):
    _training()
    names = example("A reward term")
    monkeypatch.setitem(sys.modules, "example", types.SimpleNamespace(**names))
    result, kept = _through(names["settings"], tmp_path)
    assert result.robot == "bp2"
    assert "reward/sideways_velocity" in kept["progress"].log[0]
    assert kept["settings"].reward["sideways_velocity"].weights == (-0.5, -2.0)


@pytest.mark.slow
@pytest.mark.usefixtures("brief_trials")
def test_a_robot_of_ones_own_trains_exports_and_races(example, tmp_path):
    example("A robot")
    result, kept = _through(_training()(robot="longshank"), tmp_path)
    assert result.robot == kept["settings"].robot == "longshank"


def test_a_schedule_that_lacks_something_is_refused_before_the_training(tmp_path):
    from sprintlab.commands import check_schedule
    from sprintlab.core.errors import InvalidValueError

    class Old:
        targets = None

        def advance(self, state):
            return state

    with pytest.raises(InvalidValueError, match="must take the state and a CommandStep"):
        check_schedule(Old())
    with pytest.raises(InvalidValueError, match="needs targets and advance"):
        check_schedule(3)
