"""Controller and robot on a bus: two processes as the documentation starts them, and a link with losses."""

import json
import os
import shlex
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from pathlib import Path

import pytest
from tests.deployment.conftest import COARSE

from sprintlab.cli.main import main
from sprintlab.deployment.controller import Controller, LoopOptions, run_loop
from sprintlab.deployment.guard import Fault
from sprintlab.deployment.operators import SprintSource
from sprintlab.deployment.simulator import (
    LinkOptions,
    SimulatedWorld,
    SimulatorOptions,
    run_simulator,
)
from sprintlab.deployment.transports import open_bus, open_endpoint
from sprintlab.plant import PlantOptions

PAGE = Path(__file__).resolve().parents[2] / "docs" / "deployment.md"


@pytest.fixture
def bus():
    return f"shm://run-{os.getpid()}"


def documented_words(command):
    """The lock-step command line of the documentation that begins so, split into words."""
    lines = [line for line in PAGE.read_text(encoding="utf-8").splitlines() if line.startswith(command)]
    return next(shlex.split(line)[1:] for line in lines if "--lock-step" in line)


@pytest.mark.slow
@pytest.mark.usefixtures("hurried", "unlocked_memory", "blank_pictures")
def test_the_documented_sprint_reaches_its_line_and_its_report_is_drawn(bus, tmp_path, monkeypatch, capsys):
    """Over 3 m at 4 m/s instead of 100 m: the same way through all modes in a quarter of the time."""
    pytest.importorskip("mcap")
    monkeypatch.chdir(tmp_path)
    _, address, *options = documented_words("sprintlab robot-sim")
    _, policy, same, *controls = documented_words("sprintlab run")
    assert (address, policy) == (same, "sprint")
    command = [sys.executable, "-m", "sprintlab.cli.main", "robot-sim", bus, *options, "--json"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as robot:
        line = robot.stderr.readline()
        assert line.startswith(f"the robot is on {bus}"), line + robot.stderr.read()
        short = ("--top-speed", "4", "--distance", "3", "--json")
        assert main(["run", policy, bus, *controls, *short]) == 0
        run, simulated = json.loads(capsys.readouterr().out), json.loads(robot.stdout.read())
    assert robot.returncode == 0
    assert run["end"] == "passive" and run["faults"] == {} and 1.0 < run["sprint_time"] < 2.0
    assert simulated["fall_reason"] == "" and simulated["watchdog_trips"] == 0
    assert simulated["commands_dropped"] == 0 and 3.0 < simulated["greatest_distance"] < 15.0
    assert abs(simulated["commands_accepted"] - run["steps"]) <= 1
    log = next(tmp_path.rglob("*.mcap"))
    assert main(["report", str(log), "--distance", "3", "--json", "--output", str(tmp_path / "report")]) == 0
    numbers = json.loads(capsys.readouterr().out)
    assert numbers["time_over_distance_s"] == pytest.approx(run["sprint_time"], abs=0.1)
    assert numbers["simulation"]["speed_difference_rms_m_s"] < 0.5
    assert numbers["faults"] == {} and not numbers["fell"] and numbers["facts"]["ticks dropped"] == "0"
    assert (tmp_path / "report" / "report.html").read_text().count("<img") == 5


@pytest.mark.usefixtures("hurried", "unlocked_memory")
def test_loss_and_jitter_are_ridden_out(bus, sprint_policy, robot):
    """Both loops in one process, on coarse steps of physics; each waits for the other."""
    noisy = SimulatorOptions(plant=PlantOptions(**COARSE), noise=1.0)
    world = SimulatedWorld(robot, noisy, LinkOptions(jitter=0.001, loss=0.05))
    controller = Controller(sprint_policy, robot, SprintSource(4.0, 2.0))
    pace = {"lock_step": True, "end_with_controller": True}
    with ThreadPoolExecutor(1) as threads, closing(open_endpoint(bus)) as endpoint:
        simulator = threads.submit(run_simulator, world, endpoint, **pace)
        with closing(open_bus(bus, session=controller.session)) as interface:
            run = run_loop(controller, interface, LoopOptions(lock_step=True, priority=None))
        simulated = simulator.result()
    assert run.end == "passive"
    assert (
        set(controller.fault_counts) == {Fault.STATE_LOST} and controller.fault_counts[Fault.STATE_LOST] > 50
    )
    assert simulated.fall_reason == "" and 2.0 < simulated.greatest_distance < 15.0
