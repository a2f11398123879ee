"""A command that is asked to terminate tidies up first."""

import json
import os
import signal
import subprocess
import sys
from types import SimpleNamespace

import pytest

from sprintlab.cli.interruptions import counted_interruptions, tidy_termination
from sprintlab.cli.main import main
from sprintlab.cli.run import _status_line
from sprintlab.deployment.controller.loop import LoopReport
from sprintlab.deployment.controller.modes import Mode

CODE = """
import sys, time
from sprintlab.cli import main as command
from sprintlab.core.files import atomic_directory, reserved_directory

def race(arguments):
    with reserved_directory("race") as folder, atomic_directory(folder) as temporary:
        (temporary / "half").touch()
        print("filling", flush=True)
        while True:  # a signal just before a sleep is seen after it: a long one would outlast the test
            time.sleep(0.05)

command.run = race
sys.exit(command.main([]))
"""


@pytest.fixture
def hanging_up():
    """The signal of a lost terminal at its default: whoever runs the tests may ignore it (``nohup``)."""
    before = signal.signal(signal.SIGHUP, signal.SIG_DFL)
    yield
    signal.signal(signal.SIGHUP, before)


@pytest.mark.usefixtures("hanging_up")
def test_a_terminal_that_goes_away_counts_once():
    with counted_interruptions() as count:
        os.kill(os.getpid(), signal.SIGHUP)
        os.kill(os.getpid(), signal.SIGHUP)
        assert count() == 1  # a second would stop the robot in full run instead of braking
        os.kill(os.getpid(), signal.SIGINT)
        assert count() == 2


@pytest.mark.usefixtures("hanging_up")
@pytest.mark.parametrize(
    ("numbers", "counted"),
    [
        ((signal.SIGTERM, signal.SIGHUP, signal.SIGHUP), 1),  # what systemd sends when a session ends
        ((signal.SIGHUP, signal.SIGTERM), 1),
        ((signal.SIGTERM, signal.SIGTERM), 1),
        ((signal.SIGINT, signal.SIGTERM), 1),  # a program that hands a Ctrl-C on
        ((signal.SIGTERM, signal.SIGINT), 2),
        ((signal.SIGINT, signal.SIGINT), 2),
    ],
)
def test_one_request_that_is_told_in_several_signals_counts_once(numbers, counted):
    """A session's end damped a robot in full run, and it fell; a second Ctrl-C means what it says."""
    with counted_interruptions() as count:
        for number in numbers:
            os.kill(os.getpid(), number)
        assert count() == counted


@pytest.mark.usefixtures("hanging_up")
def test_a_termination_signal_that_comes_again_later_counts_and_a_hangup_does_not(monkeypatch):
    moment = [100.0]
    clock = SimpleNamespace(monotonic=lambda: moment[0])
    monkeypatch.setattr("sprintlab.cli.interruptions.time", clock)
    with counted_interruptions() as count:
        for number in (signal.SIGTERM, signal.SIGHUP, signal.SIGTERM):
            os.kill(os.getpid(), number)
            moment[0] += 5.0
        assert count() == 2


def test_termination_signals_that_come_again_and_again_stop_the_robot(monkeypatch):
    """Of a signal every half a second each put off the moment at which the next would count."""
    moment = [100.0]
    clock = SimpleNamespace(monotonic=lambda: moment[0])
    monkeypatch.setattr("sprintlab.cli.interruptions.time", clock)
    with counted_interruptions() as count:
        for counted in (1, 1, 2):
            os.kill(os.getpid(), signal.SIGTERM)
            assert count() == counted
            moment[0] += 0.5


class Found:
    """The numbers of a run, or of a simulated robot."""

    log_problem, in_order, report = None, True, SimpleNamespace(fall_reason="")

    def to_dict(self):
        return {"duration": 1.0}


class Leaving:
    """A run during whose leaving somebody asks again, and the terminal goes away."""

    def __init__(self, *arguments, **options):
        pass

    def __enter__(self):
        return self

    def __exit__(self, *_):
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGHUP):
            os.kill(os.getpid(), number)

    def run(self, *arguments, **options):
        return Found()


@pytest.mark.usefixtures("hanging_up")
@pytest.mark.parametrize("command", ["run", "robot-sim"])
def test_who_asks_again_while_a_run_leaves_is_told_its_numbers_all_the_same(command, monkeypatch, capsys):
    monkeypatch.setattr("sprintlab.cli.run.RobotRun", Leaving)
    monkeypatch.setattr("sprintlab.cli.robot_sim.RobotSimulation", Leaving)
    assert main([command, "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == {"duration": 1.0}


def test_a_run_that_shall_outlive_its_terminal_does():
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with counted_interruptions() as count:
            os.kill(os.getpid(), signal.SIGHUP)
            assert count() == 0
    finally:
        signal.signal(signal.SIGHUP, before)


def test_the_status_line_survives_its_terminal(monkeypatch):
    """An error in it would end the loop in full run."""
    controlling, terminal = os.openpty()
    with os.fdopen(terminal, "w") as stream:
        monkeypatch.setattr("sys.stderr", stream)
        controller = SimpleNamespace(commanded_speed=9.0, fault_counts={}, stop_reason="", mode=Mode.RUN)
        with _status_line(quiet=False) as show:
            show(controller, LoopReport())
            assert os.read(controlling, 1000)
            os.close(controlling)
            show(controller, LoopReport())


@pytest.mark.usefixtures("hanging_up")
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_a_race_that_is_terminated_leaves_nothing(tmp_path, number):
    """Nor one whose terminal goes away."""
    race = subprocess.Popen([sys.executable, "-c", CODE], cwd=tmp_path, stdout=subprocess.PIPE)
    assert race.stdout is not None and race.stdout.readline() == b"filling\n"
    os.kill(race.pid, number)
    race.communicate(timeout=300)
    assert race.returncode == 128 + number
    assert not list(tmp_path.iterdir())


@pytest.fixture
def ctrl_c():
    """Ctrl-C at its default: whoever runs the tests may ignore it, as a shell does for its background."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


class Losing:
    """Python prints what is raised while an object goes away, and goes on."""

    def __del__(self):
        os.kill(os.getpid(), signal.SIGINT)


@pytest.mark.usefixtures("ctrl_c")
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_a_run_whose_first_ctrl_c_was_lost_does_not_begin():
    """It came while modules were imported; the robot stood up all the same."""
    driven = []
    with pytest.raises(KeyboardInterrupt), tidy_termination():
        del [Losing()][0]
        with counted_interruptions():
            driven.append(True)
    assert not driven
    with counted_interruptions() as count:  # the next one begins anew
        assert count() == 0


@pytest.mark.usefixtures("ctrl_c")
@pytest.mark.parametrize(("number", "ends"), [("SIGINT", KeyboardInterrupt), ("SIGTERM", SystemExit)])
def test_a_storm_of_signals_does_not_end_the_tidying(number, ends):
    tidied = []
    with pytest.raises(ends), tidy_termination():
        try:
            os.kill(os.getpid(), getattr(signal, number))
        finally:
            for _ in range(20):
                os.kill(os.getpid(), getattr(signal, number))
            tidied.append(True)
    assert tidied


@pytest.mark.usefixtures("ctrl_c")
def test_an_interrupted_function_that_says_something_else_was_interrupted():
    """As a compiled one of MuJoCo's does."""
    with pytest.raises(KeyboardInterrupt), tidy_termination():
        try:
            os.kill(os.getpid(), signal.SIGINT)
        except KeyboardInterrupt:
            raise TypeError("incompatible function arguments") from None
