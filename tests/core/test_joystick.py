"""Joystick devices, played by a named pipe."""

import os
import struct
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sprintlab.core.joystick import Joystick, JoystickError


def event(kind, number, value):
    return struct.pack("=IhBB", 0, value, kind, number)


@pytest.fixture
def pad(tmp_path):
    device = tmp_path / "js0"
    os.mkfifo(device)
    keep = os.open(device, os.O_RDWR | os.O_NONBLOCK)
    joystick = Joystick(device)
    writing = os.open(device, os.O_WRONLY)
    os.close(keep)
    yield writing, joystick
    joystick.close()


def test_a_press_is_told_once_and_held_until_it_is_let_go(pad):
    writing, joystick = pad
    os.write(writing, event(1, 3, 1) + event(1, 0, 1))
    assert joystick.poll() == (3, 0)
    assert joystick.poll() == ()
    assert joystick.held == {0, 3}
    os.write(writing, event(1, 3, 0))
    assert joystick.poll() == ()
    assert joystick.held == {0}


def test_what_is_down_at_the_start_is_held_but_was_not_pressed(pad):
    writing, joystick = pad
    os.write(writing, event(0x81, 5, 1) + event(0x82, 1, -32767))
    assert joystick.poll() == ()
    assert joystick.held == {5}
    assert joystick.axis(1) == -1.0


@given(value=st.integers(-32768, 32767), zone=st.floats(0.0, 0.9))
def test_an_axis_goes_from_minus_one_to_one_beyond_its_dead_zone(value, zone):
    reading, writing = os.pipe()
    joystick = Joystick(Path(f"/dev/fd/{reading}"))
    os.write(writing, event(2, 4, value))
    joystick.poll()
    deflection = joystick.axis(4, zone)
    for descriptor in (reading, writing):
        os.close(descriptor)
    joystick.close()
    assert -1.0 <= deflection <= 1.0
    assert deflection * value >= 0.0
    assert (deflection == 0.0) == (min(abs(value) / 32767, 1.0) <= zone)
    assert abs(value) < 32767 or abs(deflection) == pytest.approx(1.0)


def test_other_files_are_refused(tmp_path):
    (tmp_path / "file").write_text("no events")
    for name, reason in (("js7", "js7: No such file"), ("file", "is no gamepad"), ("", "is no gamepad")):
        with pytest.raises(JoystickError, match=reason):
            Joystick(tmp_path / name)
