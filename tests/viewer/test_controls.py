"""Every control of the live page, turned in a real browser; what it did is read from the session."""

import os
import struct
import threading
import time

import pytest

from sprintlab.viewer.live import Session

pytest.importorskip("viser", reason="needs viser: pip install 'sprintlab[play]'")

from sprintlab.viewer.page import Page

PATIENCE = 180_000  # milliseconds; software rendering on a shared core is slow


@pytest.fixture(scope="module")
def pad(tmp_path_factory):
    """A gamepad: the device and the pipe that its events are written to."""
    device = tmp_path_factory.mktemp("pad") / "js0"
    os.mkfifo(device)
    writing = os.open(device, os.O_RDWR | os.O_NONBLOCK)
    yield device, writing
    os.close(writing)


@pytest.fixture(scope="module")
def page(robot, policy, pad):
    """A page that simulates in a thread of its own."""
    session = Session(robot, {"sprint": policy, "again": policy})
    served = Page(session, port=8261, gamepad=pad[0])
    # Without a GPU, a picture lit by viser's photograph of a hall takes seconds, and the page stands still.
    served.server.scene.configure_environment_map(None)
    served.server.scene.configure_default_lights(cast_shadow=False)
    thread = threading.Thread(target=served.run)
    thread.start()
    yield served
    served.end()
    thread.join(120.0)
    assert not thread.is_alive()


@pytest.fixture(scope="module")
def window(browser, page):
    """The page in one tab for all tests, whose script errors fail the last of them."""
    tab = browser.new_page(viewport={"width": 900, "height": 700})
    tab.set_default_timeout(PATIENCE)
    errors = []
    tab.on("pageerror", lambda error: errors.append(error))
    tab.goto(page.address)
    tab.wait_for_selector("#status")
    yield tab
    tab.close()
    assert errors == []


@pytest.fixture
def knobs(page, window):
    """Waits until the session's knobs are as expected; puts the robot on its feet first."""
    page.session.turn(speed=0.0, yaw_rate=0.0)

    def expect(**wanted):
        until(
            window, lambda: all(getattr(page.session.knobs, name) == value for name, value in wanted.items())
        )

    return expect


def until(window, condition):
    """Let the page work until something holds."""
    deadline = time.monotonic() + 1e-3 * PATIENCE
    while not condition():
        assert time.monotonic() < deadline, "it did not happen in time"
        window.wait_for_timeout(50)


def status(window, name):
    return float(window.evaluate(f"document.getElementById('status').dataset.{name}"))


def control(window, label, kind="input"):
    """The control that belongs to a label: its number field, its box or its list."""
    return window.locator(f"xpath=//label[.='{label}']/following::{kind}").first


def enter(window, label, value):
    """Type a number beside a slider."""
    field = control(window, label, "input[@type='text' or @inputmode]")
    field.fill(str(value))
    field.press("Enter")


def choose(window, label, option):
    """Choose from a list."""
    control(window, label).click()
    window.get_by_role("option", name=option, exact=True).click()


def press(window, name):
    window.get_by_role("button", name=name, exact=True).click()


@pytest.mark.parametrize(
    ("label", "number", "knob", "value"),
    [
        ("Speed (m/s)", 1.5, "speed", 1.5),
        ("Turn (rad/s)", -0.4, "yaw_rate", -0.4),
        ("Bus voltage (V)", 48, "bus_voltage", 48.0),
        ("Friction", 0.6, "friction", 0.6),
        ("Payload (kg)", 3, "payload", 3.0),
        ("Slope (deg)", 0.5, "slope", pytest.approx(0.0087, abs=1e-4)),
    ],
)
def test_slider_turns_its_knob(window, knobs, label, number, knob, value):
    enter(window, label, number)
    knobs(**{knob: value})


def test_the_robot_runs_as_the_slider_says_until_a_key_stops_it(window, knobs):
    enter(window, "Speed (m/s)", 2)
    window.wait_for_function("Number(document.getElementById('status').dataset.speed) > 1.5")
    assert window.locator("svg.envelope circle").count() == 12
    control(window, "Speed (m/s)", "input[@type='text' or @inputmode]").blur()
    window.keyboard.press("x")
    knobs(speed=0.0)


def test_policy_and_motor_model_change_while_the_robot_runs(window, knobs):
    choose(window, "Policy", "again")
    knobs(policy="again")
    assert window.locator("svg.envelope .used").count() == 0
    choose(window, "Motor model", "square")
    knobs(motor_model="square")
    window.wait_for_function("document.querySelectorAll('svg.envelope .used').length === 3")


def test_a_hard_push_throws_the_robot_down_and_it_stands_up_again(window, page, knobs):
    enter(window, "Push (N s)", 100)
    before = status(window, "falls")
    for _ in range(4):
        press(window, "Left")
    window.wait_for_function(f"Number(document.getElementById('status').dataset.falls) > {before}")
    until(window, lambda: page.session.plant.fall_reason == "")


def test_sticks_move_the_sliders_and_buttons_act(window, page, pad, knobs, monkeypatch):
    _, writing = pad
    assert "connected" in window.inner_text("#gamepad")
    os.write(writing, event(2, 1, -8000) + event(2, 3, 32767))
    knobs(speed=2.5, yaw_rate=-1.0)
    field = control(window, "Speed (m/s)", "input[@type='text' or @inputmode]")
    until(window, lambda: field.input_value() == "2.5")
    os.write(writing, event(1, 2, 1))
    knobs(speed=0.0, yaw_rate=0.0)
    pushes, push = [], page.session.plant.push  # counted: a look at the speed may come when it is over
    monkeypatch.setattr(page.session.plant, "push", lambda *change: (pushes.append(change), push(*change)))
    os.write(writing, event(1, 0, 1))
    until(window, lambda: len(pushes) == 1)
    assert pushes[0][0] == 0.0 and pushes[0][1] < 0.0  # to the right


def event(kind, number, value):
    return struct.pack("=IhBB", 0, value, kind, number)
