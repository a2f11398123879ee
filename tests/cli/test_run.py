"""``sprintlab run`` and ``robot-sim``: clearance before the bus, logs, and what a run tells."""

import json

import numpy as np
import pytest

import sprintlab as sl
from sprintlab import control
from sprintlab.api import robot_bus
from sprintlab.deployment.controller import run_loop
from sprintlab.deployment.transports import open_endpoint

BEYOND = "unitree://go2@no-such-interface"


@pytest.fixture(autouse=True)
def in_a_folder_of_its_own(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


@pytest.fixture
def impatient(monkeypatch):
    """A loop that waits for a robot for a fifth of a second."""

    def run(controller, bus, options, **more):
        object.__setattr__(options, "patience", 0.2)
        return run_loop(controller, bus, options, **more)

    monkeypatch.setattr("sprintlab.deployment.controller.run_loop", run)


def test_a_policy_is_opened_once_and_tells_its_robot(call, monkeypatch):
    opened, load = [], control.load_policy
    monkeypatch.setattr(control, "load_policy", lambda path: opened.append(path.name) or load(path))
    assert "no robot named 'not-here' runs" in call("run", "go1-sprint", "shm://not-here").err
    assert opened == ["go1-sprint.onnx"]


def test_beyond_this_machine_a_policy_is_audited_before_the_bus_is_opened(call, monkeypatch):
    pytest.importorskip("cyclonedds")
    asked = []
    judge = "sprintlab.api.clearance.objections"
    monkeypatch.setattr(judge, lambda policy, robot, speed, **how: asked.append((speed, how)) or [])
    words = ("run", "sprint", BEYOND, "--no-log", "--top-speed", "3")
    assert "cannot join DDS domain" in call(*words, "--source", "sprint-raw").err
    call(*words, "--despite-audit", "sprint")
    call("run", "sprint", "shm://not-here", "--no-log", "--top-speed", "3")
    assert asked == [(3.0, {"self_paced": False})]
    monkeypatch.setattr(judge, lambda *_, **__: ["it fell"])
    assert "it fell. Lower --top-speed, or give --despite-audit sprint" in call(*words).err


@pytest.mark.parametrize(
    ("stored", "said"),
    [(3.0, "top speed: 3 m/s, the highest at which sprint passes"), (0.0, "top speed: 1 m/s, although")],
)
def test_without_a_top_speed_it_is_one_at_which_the_policy_passes(call, monkeypatch, stored, said):
    monkeypatch.setattr("sprintlab.api.clearance.stored_speed", lambda policy: stored)
    outcome = call("run", "sprint", "shm://not-here", "--no-log")
    assert said in outcome.err
    outcome = call("run", "sprint", BEYOND, "--no-log")
    assert outcome.status == 2
    assert ("at no speed from 1 m/s on: give --top-speed and --despite-audit" in outcome.err) == (not stored)


def test_a_run_is_logged_unless_told_otherwise(call, monkeypatch, tmp_path):
    monkeypatch.setattr(robot_bus, "find_spec", lambda name: object())
    path = robot_bus.log_path(None, "unitree://go2@10.0.0.7")
    assert path.parent.name == "runs" and path.match("go2-10-0-0-7-????????-??????.mcap")
    monkeypatch.setattr(robot_bus, "find_spec", lambda name: None)
    assert "sprintlab[log]" in call("run", "sprint", "shm://not-here", "--top-speed", "3").err
    assert not list(tmp_path.rglob("*.mcap")), "where no robot is, no log is left behind"


@pytest.mark.usefixtures("unlocked_memory", "impatient")
def test_a_robot_that_says_nothing_is_given_up_with_a_table(call):
    """Status 1, the table tells why, only ``off`` was sent."""
    endpoint = open_endpoint("shm://mute-for-a-test")
    try:
        words = ("run", "sprint", "shm://mute-for-a-test", "--no-real-time", "--top-speed", "3", "--no-log")
        outcome = call(*words)
        numbers = json.loads(call(*words, "--json").out)
        sent = []
        while (command := endpoint.receive_command()) is not None:
            sent.append(command)
    finally:
        endpoint.close()
    assert outcome.status == 1
    assert "no robot answers" in outcome.out and "deadline misses" in outcome.out
    lacks = outcome.err.index("real time: no real-time priority was asked for")
    assert lacks < outcome.err.index("driving shm://mute-for-a-test")  # said before it drives
    assert sent and not any(np.any(command.stiffness) for command in sent)
    assert numbers["sprint_time"] is None and numbers["log_problem"] is None


def test_a_simulated_robot_tells_its_numbers():
    found = sl.robot_sim("shm://alone-for-a-test", duration=0.05, real_time=False)
    numbers = found.to_dict()
    assert numbers["simulated_time"] == pytest.approx(0.05, abs=2e-3)
    assert (numbers["commands_accepted"], numbers["fall_reason"], found.status) == (0, "", 0)
    assert "watchdog trips" in str(found)
    with pytest.raises(sl.SprintlabError, match="unknown"):
        sl.robot_sim("shm://alone-for-a-test", robot="no-such-robot")
    endpoint = open_endpoint("shm://alone-for-a-test")  # the refused one has left the bus
    endpoint.close()
