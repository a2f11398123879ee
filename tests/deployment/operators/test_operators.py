"""Command sources: what they wish, how fast it changes, and how they fall silent."""

import os
import pty
import struct

import numpy as np
import pytest

from sprintlab.deployment.operators import (
    ProfileSource,
    SprintSource,
    load_velocity_table,
)
from sprintlab.deployment.operators.base import Request, SourceView, TrackPoint
from sprintlab.deployment.operators.devices import GamepadSource, KeyboardSource


def view(time, mode="run", running=None, distance=0.0, speed=0.0, heading=0.0, offset=0.0, fix=True):
    track = TrackPoint(distance, offset, speed) if fix else None
    return SourceView(time, mode, time if running is None else running, heading, track)


# --- scripts -------------------------------------------------------------------------------------------


def test_a_sprint_rises_holds_and_brakes_at_the_distance():
    source = SprintSource(8.0, 50.0, pace=False)
    way, speeds = 0.0, [0.0]
    while (wish := source.wish(view(0.02 * len(speeds), distance=way, speed=speeds[-1]))) is not None:
        speeds.append(wish[0])
        way += 0.02 * wish[0]
    assert max(speeds) == 8.0 and speeds[-1] == 0.0
    assert speeds[100] == pytest.approx(4.0, abs=0.1)  # 1 s of standing, 1 s of 4 m/s^2
    assert source.finish_time == pytest.approx(1.0 + 2.0 + (50.0 - 8.0) / 8.0, abs=0.15)


def test_a_sprint_steers_back_to_its_course_and_is_silent_without_fixes():
    source = SprintSource(8.0, pace=False)
    assert source.wish(view(4.0, heading=0.1))[2] < 0.0
    assert source.wish(view(4.1, offset=-1.0))[2] > 0.0
    assert source.read(view(4.2)) is not None
    assert source.read(view(4.3, fix=False)) is None


def test_a_scripted_source_asks_for_every_mode_in_turn_and_is_finished():
    source = SprintSource(4.0, 1.0, pace=False)
    moments = [
        (view(0.0, "passive"), Request.STAND),
        (view(1.0, "stand-up"), Request.NONE),
        (view(2.0, "stand"), Request.NONE),
        (view(3.0, "stand"), Request.RUN),
        (view(4.0, running=1.0), Request.NONE),
        (view(5.0, running=2.0, distance=5.0), Request.NONE),
        (view(9.0, running=6.0, distance=5.0), Request.STAND),
        (view(10.0, "stand"), Request.LIE_DOWN),
        (view(12.0, "passive"), Request.NONE),
    ]
    assert [source.read(moment).request for moment, _ in moments] == [request for _, request in moments]


def test_a_profile_goes_straight_between_its_lines_and_its_steps_become_ramps(tmp_path):
    path = tmp_path / "run.csv"
    path.write_text("time, forward, yaw_rate\n0, 0, 0\n2, 6, 0.5\n2, 0, 0.5\n4, 0, 0\n")
    source = ProfileSource(load_velocity_table(path))
    wishes = [source.wish(view(0.02 * step)) for step in range(201)]
    np.testing.assert_allclose(wishes[50], [3.0, 0.0, 0.25])
    speeds = np.array(wishes)[:, 0]
    assert np.abs(np.diff(speeds)).max() <= 0.08 + 1e-9 and speeds[-1] == 0.0
    assert source.wish(view(4.1)) is None


# --- keyboard ------------------------------------------------------------------------------------------


@pytest.fixture
def terminal():
    master, slave = pty.openpty()
    source = KeyboardSource(6.0, slave)
    yield master, source
    source.close()
    source.close()
    os.close(slave)


def settled(source):
    """The command once the wish has been followed to its end."""
    return [source.read(view(1.0)) for _ in range(200)][-1]


def test_keys_change_speed_and_turn_within_bounds(terminal):
    master, source = terminal
    wishes = {
        "wwww": [2.0, 0.0, 0.0],
        "a": [2.0, 0.0, 0.2],
        "w" * 40: [6.0, 0.0, 0.2],
        " ": [0.0, 0.0, 0.0],
        "s" * 40: [-1.2, 0.0, 0.0],
    }
    for keys, wish in wishes.items():
        os.write(master, keys.encode())
        assert settled(source).velocity.tolist() == pytest.approx(wish)


@pytest.mark.parametrize(
    ("keys", "request_"),
    [
        *(("t", Request.STAND), ("r", Request.RUN), ("l", Request.LIE_DOWN), ("p", Request.PASSIVE)),
        *((keys, Request.STOP) for keys in ("x", "\x1b", "\x1bx", "xp", "xr", "xl", "\x1b[Ax", "w\x1b\x1b")),
        *((keys, Request.NONE) for keys in ("\x1b[A\x1b[B", "\x1bOP", "\x1b[3~", "\x1b[1;5C", "\xe9")),
    ],
)
def test_a_key_makes_its_request_once_and_nothing_takes_a_stop_back(terminal, keys, request_):
    """Arrows and other keys send a sequence that begins as Esc does."""
    master, source = terminal
    os.write(master, keys.encode("latin-1"))
    assert source.read(view(1.0, "stand")).request == request_
    assert source.read(view(1.1, "stand")).request == Request.NONE


def test_a_terminal_that_is_gone_silences_the_keyboard(terminal):
    master, source = terminal
    assert source.read(view(1.0)) is not None
    os.close(master)
    assert source.read(view(1.1)) is None


# --- gamepad -------------------------------------------------------------------------------------------

STAND, RUN, LIE, STOP, SWITCH = 0, 7, 1, 2, 5


@pytest.fixture
def pad(tmp_path):
    device = tmp_path / "js0"
    os.mkfifo(device)
    keep = os.open(device, os.O_RDWR | os.O_NONBLOCK)
    source = GamepadSource(device, 10.0)
    writing = os.open(device, os.O_WRONLY)
    os.close(keep)
    yield writing, source
    source.close()


def press(pad, *buttons, value=1, kind=1):
    for number in buttons:
        os.write(pad[0], struct.pack("=IhBB", 0, value, kind, number))


def push(pad, axis, value):
    press(pad, axis, value=value, kind=2)


def test_the_stick_moves_only_while_the_dead_man_switch_is_held(pad):
    push(pad, 1, -32767)
    assert settled(pad[1]).velocity.tolist() == [0.0, 0.0, 0.0]
    press(pad, SWITCH)
    assert settled(pad[1]).velocity[0] == pytest.approx(10.0)
    push(pad, 1, 32767)
    push(pad, 3, -32767)
    assert settled(pad[1]).velocity.tolist() == pytest.approx([-2.0, 0.0, 1.0])
    press(pad, SWITCH, value=0)
    assert settled(pad[1]).velocity.tolist() == [0.0, 0.0, 0.0]


def test_nothing_takes_back_a_stop_of_the_pad(pad):
    press(pad, STOP, STAND, LIE, RUN)
    assert pad[1].read(view(1.1, mode="stand")).request == Request.STOP
    assert pad[1].read(view(1.2, mode="stand")).request == Request.NONE


def test_a_run_begins_and_goes_on_only_while_the_dead_man_switch_is_held(pad):
    _, source = pad
    press(pad, SWITCH, kind=0x81)  # down from the start: it may be stuck
    press(pad, RUN)
    assert source.read(view(1.0, mode="stand")).request == Request.NONE
    press(pad, SWITCH, value=0)
    press(pad, SWITCH, RUN)
    assert source.read(view(1.1, mode="stand")).request == Request.RUN
    assert source.read(view(1.2)).request == Request.NONE
    press(pad, SWITCH, value=0)
    assert [source.read(view(moment)).request for moment in (1.3, 1.4)] == [Request.STAND] * 2
    press(pad, LIE)
    assert source.read(view(1.5)).request == Request.LIE_DOWN
