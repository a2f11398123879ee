"""``sprintlab run``: what it refuses, and that it says so before it touches a robot."""

import contextlib

import numpy as np
import pytest

from sprintlab import control
from sprintlab.api.robot_runs import RobotRun
from sprintlab.deployment.bus import open_endpoint
from sprintlab.deployment.controller import run_loop


@pytest.fixture(autouse=True)
def in_a_folder_of_its_own(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def assert_refused(outcome, *words):
    """One sentence on stderr, status 2, nothing on stdout."""
    assert (outcome.status, outcome.out) == (2, "")
    assert outcome.err.startswith("sprintlab: ") and len(outcome.err.strip().splitlines()) == 1
    for word in words:
        assert word in outcome.err


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("no-such-policy",), ("no-such-policy", "there is: ")),
        (("missing.onnx",), ("missing.onnx", "No such file")),
        (("sprint", "shm://not-here"), ("no robot named 'not-here'",)),
        (("sprint", "http://bp2"), ("bus carrier", "choose one of shm, unitree")),
        (("sprint", "bp2"), ("an address like shm://bp2",)),
        (("--robot", "bp3"), ("bp3",)),
        (("--source", "telepathy"), ("telepathy", "choose one of sprint")),
        (("--source", "profile:missing.csv"), ("missing.csv",)),
        (("--top-speed", "-3"), ("-3.0",)),
        (("--top-speed", "nan"), ("nan",)),
        (("--priority", "100"), ("loop.priority = 100", "[1, 99]")),
        (("--duration", "0"), ("loop.duration = 0.0",)),
        (("--distance", "-1"), ("distance",)),
    ],
)
def test_what_makes_no_sense_is_refused_in_one_sentence(call, arguments, words):
    assert_refused(call("run", *arguments), *words)


def test_a_policy_for_another_robot_is_refused_before_the_bus_is_opened(call, write_policy, tmp_path):
    path = write_policy(tmp_path / "weak.onnx", stiffness=(100.0,) * 12)
    outcome = call("run", path, "shm://not-here")
    assert_refused(outcome, "stiffness[FL_abad] differs: the policy has 100.0, robot bp2 has 60.0")


def test_the_robot_is_the_policy_s_unless_another_is_named(call):
    words = ("go1-sprint", "shm://not-here", "--no-log")
    assert_refused(call("run", *words), "no robot named 'not-here' runs")
    assert_refused(call("run", *words, "--robot", "bp2"), "the policy has 'go1', robot bp2 has 'bp2'")


def test_a_policy_is_opened_once_and_tells_its_robot(call, monkeypatch):
    opened, load = [], control.load_policy
    monkeypatch.setattr(control, "load_policy", lambda path: opened.append(path.name) or load(path))
    assert_refused(call("run", "go1-sprint", "shm://not-here", "--no-log"), "not-here")
    assert opened == ["go1-sprint.onnx"]


BEYOND = "unitree://go2@no-such-interface"


def test_beyond_this_machine_a_policy_is_audited_before_the_bus_is_opened(call, monkeypatch):
    pytest.importorskip("cyclonedds")
    asked = []
    monkeypatch.setattr(
        "sprintlab.api.clearance.require_clearance", lambda *what, **how: asked.append((what[-1], how))
    )
    words = ("run", "sprint", BEYOND, "--no-log", "--top-speed", "3")
    outcome = call(*words, "--source", "sprint-raw")
    assert outcome.status == 2 and "cannot join DDS domain" in outcome.err
    call(*words, "--despite-audit", "sprint")
    call("run", "sprint", "shm://not-here", "--no-log", "--top-speed", "3")
    assert asked == [(3.0, {"self_paced": False})]


def test_to_insist_on_a_policy_takes_its_own_name(call):
    outcome = call("run", "sprint", BEYOND, "--despite-audit", "slow")
    assert_refused(outcome, "--despite-audit names 'slow', but the policy is 'sprint'")


@pytest.mark.parametrize(
    ("stored", "said"),
    [(3.0, "top speed: 3 m/s, the highest at which sprint passes"), (0.0, "top speed: 1 m/s, although")],
)
def test_without_a_top_speed_it_is_one_at_which_the_policy_passes(monkeypatch, stored, said):
    monkeypatch.setattr("sprintlab.api.clearance.stored_speed", lambda policy: stored)
    remarks = []
    with (
        contextlib.closing(open_endpoint("shm://default-speed-of-a-test")),
        RobotRun("sprint", "shm://default-speed-of-a-test", log=False, remark=remarks.append) as run,
    ):
        assert run._controller._limiter.limits.forward == (stored or 1.0)
    assert any(remark.startswith(said) for remark in remarks)


def test_beyond_this_machine_a_policy_that_passes_nowhere_is_refused(call, monkeypatch):
    monkeypatch.setattr("sprintlab.api.clearance.stored_speed", lambda policy: 0.0)
    outcome = call("run", "sprint", BEYOND, "--no-log")
    assert_refused(outcome, "at no speed from 1 m/s on", "give --top-speed and --despite-audit sprint")


def test_a_log_that_exists_is_not_overwritten(call, tmp_path):
    pytest.importorskip("mcap")
    log = tmp_path / "run.mcap"
    log.write_bytes(b"of yesterday")
    assert_refused(call("run", "sprint", "shm://not-here", "--log", log), "exists already")
    assert log.read_bytes() == b"of yesterday"
    link = tmp_path / "link.mcap"
    link.symlink_to(tmp_path / "nowhere")
    assert_refused(call("run", "sprint", "shm://not-here", "--log", link), "exists already")
    assert link.is_symlink()


@pytest.mark.usefixtures("unlocked_memory")
def test_a_robot_that_says_nothing_is_given_up_with_a_table(call, monkeypatch):
    """The bus is there, its robot is mute: status 1, the table tells why, only ``off`` was sent."""

    def impatient(controller, bus, options, **more):
        object.__setattr__(options, "patience", 0.2)
        return run_loop(controller, bus, options, **more)

    monkeypatch.setattr("sprintlab.deployment.controller.run_loop", impatient)
    endpoint = open_endpoint("shm://mute-for-a-test")
    try:
        outcome = call("run", "sprint", "shm://mute-for-a-test", "--no-real-time")
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
