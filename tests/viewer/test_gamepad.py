"""A gamepad played by a named pipe."""

import os
import struct

import pytest

from sprintlab.viewer.gamepad import Gamepad, PadReading


@pytest.fixture
def device(tmp_path):
    path = tmp_path / "js0"
    os.mkfifo(path)
    return path


@pytest.fixture
def pad(device):
    keep = os.open(device, os.O_RDWR | os.O_NONBLOCK)
    gamepad = Gamepad(device)
    writing = os.open(device, os.O_WRONLY)
    os.close(keep)
    yield writing, gamepad
    gamepad.close()


def stick(number, value):
    return struct.pack("=IhBB", 0, value, 2, number)


def button(number, down=1):
    return struct.pack("=IhBB", 0, down, 1, number)


def test_sticks_say_forward_and_left_and_only_when_they_move(pad):
    writing, gamepad = pad
    assert gamepad.read() == PadReading()
    os.write(writing, stick(1, -32767) + stick(3, -32767))
    assert gamepad.read().sticks == pytest.approx((1.0, 1.0))
    assert gamepad.read().sticks is None
    os.write(writing, stick(1, 32767) + stick(3, 32767))
    assert gamepad.read().sticks == pytest.approx((-1.0, -1.0))
    os.write(writing, stick(1, 900) + stick(3, -900))
    assert str(gamepad.read().sticks) == "(0.0, 0.0)"


@pytest.mark.parametrize(
    ("number", "action"), list(enumerate(["push-right", "push-left", "stop", "stand-up"]))
)
def test_every_button_does_its_action_once(pad, number, action):
    writing, gamepad = pad
    os.write(writing, button(number) + button(9) + button(number, 0))
    assert gamepad.read().actions == (action,)
    assert gamepad.read().actions == ()


def test_an_unplugged_pad_asks_for_a_stop_once(pad):
    writing, gamepad = pad
    os.write(writing, stick(1, -32767))
    assert gamepad.read().sticks is not None
    os.close(writing)
    assert gamepad.read() == PadReading(actions=("stop",))
    assert not gamepad.connected
    assert gamepad.read() == PadReading()
