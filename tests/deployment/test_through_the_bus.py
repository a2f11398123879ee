"""Controller and robot as two processes, as the documentation starts them."""

import json
import os
import shlex
import subprocess
import sys
from pathlib import Path

import pytest
from tests.deployment import quick
from tests.forked import Forked

from sprintlab.cli.main import main
from sprintlab.deployment.log import read_log

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "deployment.md"
SPRINTLAB = [sys.executable, "-m", "sprintlab.cli.main"]


@pytest.fixture(autouse=True)
def in_a_folder_of_its_own(tmp_path, monkeypatch):
    """Runs leave their logs in the working directory."""
    monkeypatch.chdir(tmp_path)


def hurried(*arguments, **options):
    """The command in a hurry, in a process of its own."""
    return Forked(quick.main, *arguments, **options)


def documented(*arguments, **options):
    """The command as a user starts it."""
    return subprocess.Popen(
        [*SPRINTLAB, *arguments], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, **options
    )


def start_robot(bus, *arguments, start=hurried):
    """A robot that is on its bus."""
    robot = start("robot-sim", bus, "--json", *arguments)
    assert robot.stderr is not None
    line = robot.stderr.readline()
    assert line.startswith(f"the robot is on {bus}"), line + robot.stderr.read()
    return robot


def drive(bus, robot, *arguments, patience=1500, start=hurried, **options):
    """Drive a robot to the end; controller's status and report, robot's status and report."""
    controller = start("run", "sprint", bus, "--json", *arguments, **options)
    out, err = controller.communicate(timeout=patience)
    robot_out, robot_err = robot.communicate(timeout=patience)
    assert out, err
    assert robot_out, robot_err
    return controller.returncode, json.loads(out), robot.returncode, json.loads(robot_out)


@pytest.fixture
def bus():
    return f"shm://run-{os.getpid()}"


def documented_words(command):
    """The lock-step command line of the documentation that begins so, split into words."""
    lines = [line for line in PAGE.read_text(encoding="utf-8").splitlines() if line.startswith(command)]
    return next(shlex.split(line)[1:] for line in lines if "--lock-step" in line)


@pytest.mark.slow
def test_the_documented_sprint_reaches_its_line_and_its_report_is_drawn(bus, tmp_path, capsys):
    """Over 3 m at 4 m/s instead of 100 m: the same way through all modes in a quarter of the time."""
    pytest.importorskip("mcap")
    _, address, *options = documented_words("sprintlab robot-sim")
    _, policy, same, *controls = documented_words("sprintlab run")
    assert (address, policy) == (same, "sprint")
    robot = start_robot(bus, *options, start=documented)
    short = ("--top-speed", "4", "--distance", "3")
    status, run, robot_status, simulated = drive(bus, robot, *controls, *short, start=documented)
    assert (status, robot_status) == (0, 0), run
    assert run["end"] == "passive"
    assert run["faults"] == {}
    assert 1.0 < run["sprint_time"] < 2.0
    assert simulated["fall_reason"] == "" and simulated["watchdog_trips"] == 0
    assert simulated["commands_dropped"] == 0 and 3.0 < simulated["greatest_distance"] < 15.0
    assert abs(simulated["commands_accepted"] - run["steps"]) <= 1
    log = next(tmp_path.glob("*.mcap"))
    assert read_log(log).facts["ticks dropped"] == "0"
    capsys.readouterr()
    assert main(["report", str(log), "--distance", "3", "--json", "--output", str(tmp_path / "report")]) == 0
    numbers = json.loads(capsys.readouterr().out)
    assert numbers["time_over_distance_s"] == pytest.approx(run["sprint_time"], abs=0.1)
    assert numbers["simulation"]["speed_difference_rms_m_s"] < 0.5
    assert numbers["faults"] == {} and not numbers["fell"]
    assert (tmp_path / "report" / "report.html").read_text().count("<img") == 5


def test_loss_and_jitter_are_ridden_out(bus):
    robot = start_robot(
        bus, "--lock-step", "--end-with-controller", "--loss", "5", "--jitter", "1", "--noise", "1"
    )
    _, run, _, simulated = drive(bus, robot, "--lock-step", "--no-log", "--top-speed", "4", "--distance", "2")
    assert run["end"] == "passive"
    assert set(run["faults"]) <= {"state-lost"} and run["faults"]["state-lost"] > 50
    assert simulated["fall_reason"] == ""
    assert 2.0 < simulated["greatest_distance"] < 15.0
