"""The live page in a real browser."""

import json
import subprocess
import sys
import threading

import pytest

from sprintlab.cli.main import main
from sprintlab.core.errors import InvalidValueError

pytest.importorskip("viser", reason="needs viser: pip install 'sprintlab[play]'")

PATIENCE = 60_000  # milliseconds; software rendering on a shared core is slow


@pytest.fixture(scope="module")
def address():
    """The address of a running ``sprintlab play``."""
    command = [sys.executable, "-m", "sprintlab.cli.main", "play", "--port", "8231", "--json"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        watchdog = threading.Timer(60.0, process.kill)
        watchdog.start()
        lines = [process.stdout.readline() for _ in range(3)]
        watchdog.cancel()
        yield json.loads("".join(lines))["address"]
        process.terminate()


def status(tab, name):
    return float(tab.evaluate(f"document.getElementById('status').dataset.{name}"))


def test_page_loads_robot_moves_a_slider_and_a_key_change_the_speed(tab, address):
    tab.goto(address)
    tab.wait_for_selector("#status", timeout=PATIENCE)
    assert tab.locator("canvas").count() >= 1
    assert abs(status(tab, "speed")) < 0.5
    slider = tab.locator("input[type=text], input[inputmode]").first
    slider.fill("3")
    slider.press("Enter")
    tab.wait_for_function("Number(document.getElementById('status').dataset.command) > 2.9", timeout=PATIENCE)
    tab.wait_for_function("Number(document.getElementById('status').dataset.speed) > 2.0", timeout=PATIENCE)
    assert status(tab, "distance") > 0.5
    assert tab.locator("svg.envelope circle").count() == 12
    slider.blur()
    tab.keyboard.press("x")
    tab.wait_for_function("Number(document.getElementById('status').dataset.command) < 0.1", timeout=PATIENCE)


def test_duration_ends_the_command(capsys):
    assert main(["play", "--port", "8240", "--duration", "0.3"]) == 0
    assert capsys.readouterr().out.count("http://localhost:") == 1


def test_policy_that_is_not_there_is_refused(capsys):
    assert main(["play", "no-such-policy"]) == 2
    assert len(capsys.readouterr().err.splitlines()) == 1


def test_port_out_of_range_is_refused():
    from sprintlab.viewer.page import PageOptions

    with pytest.raises(InvalidValueError, match="port"):
        PageOptions(port=0)
