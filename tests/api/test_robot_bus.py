"""The robot bus from Python: be a robot, drive one."""

from contextlib import closing

import pytest

import sprintlab as sl
from sprintlab.control import shipped_policy
from sprintlab.deployment.bus import open_endpoint
from sprintlab.deployment.controller import LoopOptions
from sprintlab.deployment.simulator import PaceOptions

pytestmark = pytest.mark.usefixtures("unlocked_memory")


@pytest.fixture(autouse=True)
def in_a_folder_of_its_own(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def test_a_simulated_robot_waits_for_its_controller_and_tells_numbers(tmp_path):
    pace, truth = PaceOptions(speed_factor=100.0, duration=0.05), tmp_path / "truth.npz"
    with sl.RobotSimulation("shm://api-alone", pace=pace, truth=truth) as robot:
        found = robot.run()
    numbers = found.to_dict()
    assert numbers["simulated_time"] == pytest.approx(0.05, abs=2e-3)
    assert (numbers["commands_accepted"], numbers["fall_reason"]) == (0, "")
    assert truth.is_file() and "watchdog trips" in str(found)


def test_a_run_ends_where_its_robot_is_mute_and_tells_why():
    options = LoopOptions(priority=None, patience=0.1)
    with (
        closing(open_endpoint("shm://api-mute")),
        sl.RobotRun("sprint", "shm://api-mute", options=options) as run,
    ):
        found = run.run()
    numbers = found.to_dict()
    assert not found.in_order and "no robot answers" in numbers["end"]
    assert numbers["sprint_time"] is None and numbers["log_problem"] is None
    assert "Latency" in str(found) and numbers["end"] in str(found)


def test_what_is_refused_leaves_no_robot_on_the_bus(tmp_path):
    with pytest.raises(sl.SprintlabError, match="truth"):
        sl.RobotSimulation("shm://api-refused", truth=tmp_path / "truth.npz")
    with pytest.raises(sl.SprintlabError, match="unknown"):
        sl.RobotSimulation("shm://api-refused", robot="no-such-robot")
    with pytest.raises(sl.SprintlabError, match="no robot named 'api-refused'"):
        sl.RobotRun(shipped_policy("sprint"), "shm://api-refused")
    assert not list(tmp_path.iterdir())
