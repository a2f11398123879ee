"""Command sources: what they wish, how fast it changes, and how they fall silent."""

import os
import pty
import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sprintlab.core.errors import InvalidValueError
from sprintlab.deployment.interface import PositionFix, Request, RobotState, SourceView
from sprintlab.deployment.sources import (
    GamepadSource,
    KeyboardSource,
    ProfileSource,
    Slewed,
    SlewLimits,
    SourceError,
    SprintSource,
    VelocityTable,
    load_velocity_table,
    open_source,
)

ZERO = np.zeros(12)
STATE = RobotState(
    sequence=1,
    timestamp=0,
    joint_position=ZERO,
    joint_velocity=ZERO,
    joint_torque=ZERO,
    quaternion=np.array([1.0, 0.0, 0.0, 0.0]),
    angular_velocity=np.zeros(3),
    bus_voltage=60.0,
)


def view(time, mode="run", running=None, distance=0.0, speed=0.0, heading=0.0, offset=0.0, fix=True):
    position = PositionFix(
        sequence=round(10 * time) + 1,
        timestamp=0,
        position=np.array([distance, 0.0, 0.5]),
        velocity=np.array([speed, 0.0, 0.0]),
    )
    return SourceView(
        time=time,
        running_time=(time if running is None else running) if mode == "run" else None,
        mode=mode,
        state=STATE,
        fix=position if fix else None,
        heading=heading,
        lateral_offset=offset,
        forward_speed=speed if fix else None,
    )


# --- slew limits ---------------------------------------------------------------------------------------


@given(
    wishes=st.lists(st.tuples(*[st.floats(-10.0, 10.0)] * 3), min_size=1, max_size=40),
    step=st.floats(0.001, 0.1),
)
def test_no_wish_changes_faster_than_its_limit(wishes, step):
    limits = SlewLimits(acceleration=3.0, braking=5.0, yaw_acceleration=7.0)
    slewed, before = Slewed(limits), np.zeros(3)
    for index, wish in enumerate(wishes):
        after = slewed.follow(np.array(wish), index * step)
        change = np.abs(after - before)
        assert (change[:2] <= 5.0 * step + 1e-9).all()
        assert change[2] <= 7.0 * step + 1e-9
        growing = np.abs(after[:2]) > np.abs(before[:2])
        same_side = after[:2] * before[:2] >= 0.0
        assert (change[:2][growing & same_side] <= 3.0 * step + 1e-9).all()
        before = after


def test_it_arrives_in_the_time_the_limit_allows():
    slewed = Slewed(SlewLimits(acceleration=4.0, braking=2.0))
    wish = np.array([8.0, 0.0, 0.0])
    speeds = [slewed.follow(wish, 0.02 * k)[0] for k in range(151)]
    assert speeds[100] == pytest.approx(8.0)
    assert speeds[50] == pytest.approx(4.0)
    down = [slewed.follow(np.zeros(3), 3.0 + 0.02 * k)[0] for k in range(1, 101)]
    assert down[49] == pytest.approx(6.0)


@pytest.mark.parametrize("wrong", [{"acceleration": 0.0}, {"braking": -1.0}, {"yaw_acceleration": np.nan}])
def test_impossible_limits_are_refused(wrong):
    with pytest.raises(InvalidValueError, match=f"slew.{next(iter(wrong))}"):
        SlewLimits(**wrong)


# --- sprint --------------------------------------------------------------------------------------------


def test_a_sprint_rises_holds_and_brakes_at_the_distance():
    source = SprintSource(8.0, 50.0, pace=False)
    way, speeds = 0.0, []
    for step in range(1000):
        wish = source.wish(view(0.02 * step, distance=way, speed=speeds[-1] if speeds else 0.0))
        if wish is None:
            break
        speeds.append(wish[0])
        way += 0.02 * wish[0]
    assert max(speeds) == 8.0
    assert speeds[100] == pytest.approx(4.0, abs=0.1)  # 1 s of standing, 1 s of 4 m/s^2
    assert source.finish_time == pytest.approx(1.0 + 2.0 + (50.0 - 8.0) / 8.0, abs=0.15)
    assert speeds[-1] == 0.0


def test_self_paced_the_command_stays_within_a_metre_a_second_of_the_robot():
    source = SprintSource(12.0)
    assert source.wish(view(6.0, speed=3.0))[0] == pytest.approx(4.0)
    assert source.wish(view(6.1, speed=11.9))[0] == pytest.approx(12.0)
    braking = SprintSource(12.0, 1.0)
    braking.wish(view(6.0, speed=9.0))
    assert braking.wish(view(6.1, distance=2.0, speed=9.0))[0] >= 8.0


def test_a_sprint_steers_back_to_its_course():
    source = SprintSource(8.0, pace=False)
    assert source.wish(view(4.0, heading=0.1))[2] < 0.0
    assert source.wish(view(4.1, offset=-1.0))[2] > 0.0


def test_a_sprint_without_fixes_is_silent():
    source = SprintSource(8.0)
    assert source.read(view(2.0)) is not None
    assert source.read(view(2.1, fix=False)) is None


def test_a_scripted_source_asks_for_every_mode_in_turn_and_is_finished():
    source = SprintSource(4.0, 1.0, pace=False)
    assert source.read(view(0.0, "passive")).request == Request.STAND
    assert source.read(view(1.0, "stand-up")).request == Request.NONE
    assert source.read(view(2.0, "stand")).request == Request.NONE
    assert source.read(view(3.0, "stand")).request == Request.RUN
    assert source.read(view(4.0, running=1.0)).request == Request.NONE
    source.read(view(5.0, running=2.0, distance=5.0))
    assert source.read(view(9.0, running=6.0, distance=5.0)).request == Request.STAND
    assert source.read(view(10.0, "stand")).request == Request.LIE_DOWN
    assert not source.finished
    assert source.read(view(12.0, "passive")).request == Request.NONE
    assert source.finished


def test_the_sequence_rises_with_every_reading():
    source = SprintSource(4.0)
    assert [source.read(view(0.1 * k, "stand")).sequence for k in range(4)] == [1, 2, 3, 4]


# --- profile files -------------------------------------------------------------------------------------


def test_a_csv_profile_goes_straight_between_its_lines(tmp_path):
    path = tmp_path / "run.csv"
    path.write_text("time, forward, yaw_rate\n0, 0, 0\n2, 6, 0.5\n4, 0, 0\n")
    table = load_velocity_table(path)
    np.testing.assert_allclose(table.at(1.0), [3.0, 0.0, 0.25])
    assert table.at(4.1) is None


def test_the_steps_of_a_toml_profile_become_ramps(tmp_path):
    path = tmp_path / "run.toml"
    path.write_text("[[segment]]\nduration = 2.0\nforward = 6.0\n[[segment]]\nduration = 1.0\n")
    source = ProfileSource(load_velocity_table(path), SlewLimits(acceleration=2.0, braking=2.0))
    speeds = [source.wish(view(0.1 * k))[0] for k in range(30)]
    assert speeds[10] == pytest.approx(2.0)
    assert np.abs(np.diff(speeds)).max() <= 0.2 + 1e-9
    assert source.wish(view(3.2)) is None


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("a.csv", ""),
        ("a.csv", "time,speed\n0,1\n1,2\n"),
        ("a.csv", "time,forward\n0,1\n1,fast\n"),
        ("a.csv", "time,forward\n0,1\n"),
        ("a.csv", "time,forward\n1,1\n0,2\n"),
        ("a.csv", "time,forward\n0,nan\n1,2\n"),
        ("a.csv", "time,forward\n0,1,7\n1,2\n"),
        ("a.csv", "time,forward,forward\n0,1,2\n1,2,3\n"),
        ("a.toml", "segment = 3\n"),
        ("a.toml", "[[segment]]\nduration = 1\nforward = true\n"),
        ("a.toml", "[[segment]]\nforward = 2\n"),
        ("a.toml", "[[segment]]\nduration = 1\nspeed = 2\n"),
        ("a.toml", "[[segment]]\nduration = -1\n"),
        ("a.toml", "not toml at all"),
        ("a.json", "{}"),
    ],
)
def test_files_that_are_no_profile_are_refused(tmp_path, name, content):
    path = tmp_path / name
    path.write_text(content)
    with pytest.raises((SourceError, InvalidValueError)):
        load_velocity_table(path)


def test_a_cell_that_is_no_number_is_named_by_line_and_column(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("time,forward\n0,1\n1,2_2.0\n")
    with pytest.raises(SourceError, match=r"line 3, column forward: '2_2\.0' is not a finite number"):
        load_velocity_table(path)


def test_a_missing_profile_is_refused(tmp_path):
    with pytest.raises(SourceError, match="cannot read"):
        load_velocity_table(tmp_path / "none.csv")


def test_a_table_with_falling_times_is_refused():
    with pytest.raises(InvalidValueError, match=r"profile\.time"):
        VelocityTable(time=np.array([0.0, 2.0, 1.0]), velocity=np.zeros((3, 3)))


# --- keyboard ------------------------------------------------------------------------------------------


@pytest.fixture
def terminal():
    master, slave = pty.openpty()
    source = KeyboardSource(6.0, SlewLimits(acceleration=100.0, braking=100.0), slave)
    yield master, source
    source.close()
    source.close()
    os.close(slave)


def press(terminal, keys, time=1.0, mode="run"):
    master, source = terminal
    os.write(master, keys.encode())
    source.read(view(time, mode))
    return source.read(view(time + 0.5, mode))


def test_keys_change_speed_and_turn_within_bounds(terminal):
    assert press(terminal, "wwww").velocity.tolist() == [2.0, 0.0, 0.0]
    assert press(terminal, "a", 2.0).velocity.tolist() == pytest.approx([2.0, 0.0, 0.2])
    assert press(terminal, "q", 3.0).velocity.tolist() == [2.0, 0.0, 0.0]
    assert press(terminal, "w" * 40, 4.0).velocity[0] == 6.0
    assert press(terminal, " ", 5.0).velocity.tolist() == [0.0, 0.0, 0.0]
    assert press(terminal, "s" * 40, 6.0).velocity[0] == pytest.approx(-1.2)


@pytest.mark.parametrize(
    ("key", "request_"),
    [("t", Request.STAND), ("r", Request.RUN), ("l", Request.LIE_DOWN), ("x", Request.STOP)],
)
def test_a_key_makes_its_request_once(terminal, key, request_):
    master, source = terminal
    os.write(master, key.encode())
    assert source.read(view(1.0, "stand")).request == request_
    assert source.read(view(1.1, "stand")).request == Request.NONE


def test_escape_stops_and_an_arrow_does_not(terminal):
    master, source = terminal
    os.write(master, b"\x1b[A")
    assert source.read(view(1.0)).request == Request.NONE
    os.write(master, b"\x1b")
    assert source.read(view(1.1)).request == Request.STOP


@pytest.mark.parametrize(
    "keys", ["\x1b\x1b", "\x1b`", "\x1bx", "xp", "xr", "\x1bp", "xl", "\x1b[Ax", "x\x1b[A", "w\x1b\x1b"]
)
def test_no_key_beside_it_takes_a_stop_back(terminal, keys):
    """A connection that was slow brings several at once, and who wants a stop presses more than once."""
    master, source = terminal
    os.write(master, keys.encode())
    assert source.read(view(1.0)).request == Request.STOP
    assert source.read(view(1.1)).request == Request.NONE


@pytest.mark.parametrize("keys", ["\x1b[A\x1b[B", "\x1bOP", "\x1b[[A", "\x1b[3~", "\x1b[1;5C"])
def test_keys_with_a_sequence_of_their_own_do_nothing(terminal, keys):
    master, source = terminal
    os.write(master, keys.encode())
    command = source.read(view(1.0))
    assert command.request == Request.NONE and not command.velocity.any()


@pytest.mark.parametrize("content", [b"\xe9", b"\xf8", b"\xc3", b"\xa9"])
def test_bytes_that_are_no_text_do_not_end_the_keyboard(terminal, content):
    """A letter in Latin-1, Alt in eight bits, half letters: after them no Esc was heard any more."""
    master, source = terminal
    os.write(master, content)
    assert source.read(view(1.0)).request == Request.NONE
    os.write(master, b"\x1b")
    assert source.read(view(1.1)).request == Request.STOP


def test_a_terminal_that_is_gone_silences_the_keyboard(terminal):
    master, source = terminal
    assert source.read(view(1.0)) is not None
    os.close(master)
    assert source.read(view(1.1)) is None


def test_the_keyboard_needs_a_terminal():
    reading, writing = os.pipe()
    with pytest.raises(SourceError, match="terminal"):
        KeyboardSource(6.0, descriptor=reading)
    os.close(reading)
    os.close(writing)


# --- gamepad -------------------------------------------------------------------------------------------


@pytest.fixture
def pad(tmp_path):
    device = tmp_path / "js0"
    os.mkfifo(device)
    keep = os.open(device, os.O_RDWR | os.O_NONBLOCK)
    source = GamepadSource(
        device, 10.0, SlewLimits(acceleration=100.0, braking=100.0, yaw_acceleration=100.0)
    )
    writing = os.open(device, os.O_WRONLY)
    os.close(keep)
    yield writing, source
    source.close()


def event(kind, number, value):
    return struct.pack("=IhBB", 0, value, kind, number)


def settled(source, time):
    source.read(view(time))
    return source.read(view(time + 0.5))


def test_the_stick_moves_only_while_the_alive_button_is_held(pad):
    writing, source = pad
    os.write(writing, event(2, 1, -32767))
    assert settled(source, 1.0).velocity.tolist() == [0.0, 0.0, 0.0]
    os.write(writing, event(1, 5, 1))
    assert settled(source, 2.0).velocity[0] == pytest.approx(10.0)
    os.write(writing, event(2, 1, 32767))
    assert settled(source, 3.0).velocity[0] == pytest.approx(-2.0)
    os.write(writing, event(1, 5, 0))
    assert settled(source, 4.0).velocity[0] == 0.0


def test_the_dead_zone_is_zero_and_the_turn_has_the_sign_of_the_stick(pad):
    writing, source = pad
    os.write(writing, event(1, 5, 1) + event(2, 3, 2000))
    assert settled(source, 1.0).velocity[2] == 0.0
    os.write(writing, event(2, 3, -32767))
    assert settled(source, 2.0).velocity[2] == pytest.approx(1.0)


def test_buttons_make_requests_but_not_their_first_report(pad):
    writing, source = pad
    os.write(writing, event(0x81, 2, 1))
    assert source.read(view(1.0, mode="stand")).request == Request.NONE
    os.write(writing, event(1, 2, 1))
    assert source.read(view(1.1, mode="stand")).request == Request.STOP
    assert source.read(view(1.2, mode="stand")).request == Request.NONE


@pytest.mark.parametrize("after", [0, 1, 6, 7])
def test_no_button_that_is_pressed_right_after_it_takes_a_stop_back(pad, after):
    writing, source = pad
    os.write(writing, event(1, 2, 1) + event(1, after, 1))
    assert source.read(view(1.0)).request == Request.STOP


RUN_BUTTON, LIE_BUTTON, SWITCH = 7, 1, 5


def test_a_run_begins_and_goes_on_only_while_the_dead_man_switch_is_held(pad):
    writing, source = pad
    os.write(writing, event(1, RUN_BUTTON, 1))
    assert source.read(view(1.0, mode="stand")).request == Request.NONE
    os.write(writing, event(1, SWITCH, 1) + event(1, RUN_BUTTON, 1))
    assert source.read(view(1.1, mode="stand")).request == Request.RUN
    assert source.read(view(1.2)).request == Request.NONE
    os.write(writing, event(1, SWITCH, 0))
    assert [source.read(view(moment)).request for moment in (1.3, 1.4)] == [Request.STAND] * 2
    os.write(writing, event(1, LIE_BUTTON, 1))
    assert source.read(view(1.5)).request == Request.LIE_DOWN


def test_a_switch_that_is_down_from_the_start_does_not_count(pad):
    writing, source = pad
    os.write(writing, event(0x81, SWITCH, 1) + event(2, 1, -32767))
    assert settled(source, 1.0).velocity[0] == 0.0
    assert source.read(view(2.0)).request == Request.STAND
    os.write(writing, event(1, RUN_BUTTON, 1))
    assert source.read(view(2.1, mode="stand")).request == Request.NONE
    os.write(writing, event(1, SWITCH, 0) + event(1, SWITCH, 1))
    assert settled(source, 3.0).velocity[0] == pytest.approx(10.0)


def test_letting_go_of_the_switch_brings_a_gallop_to_a_stand(pad, running):
    writing, source = pad
    os.write(writing, event(1, SWITCH, 1) + event(2, 1, -32767))
    running.controller._source, source._sequence = source, 10**6  # goes on where the other source was
    assert running.run(0.3).mode == "run" and not running.controller.braking
    os.write(writing, event(1, SWITCH, 0))
    running.run_until(lambda tick: running.controller.braking, 0.021)
    os.write(writing, event(1, SWITCH, 1))  # held again: the stand is finished all the same
    running.run_until(lambda tick: tick.mode == "stand", 6.0)
    running.run(0.5)
    assert running.controller.mode.value == "stand" and running.simulated.fall_reason == ""


def test_an_unplugged_pad_falls_silent(pad):
    writing, source = pad
    assert source.read(view(1.0)) is not None
    os.close(writing)
    assert source.read(view(1.1)) is None
    assert source.read(view(1.2)) is None


def test_a_missing_pad_is_refused(tmp_path):
    with pytest.raises(SourceError, match="js7"):
        GamepadSource(tmp_path / "js7")


# --- by name -------------------------------------------------------------------------------------------


def test_sources_open_by_name(tmp_path):
    path = tmp_path / "run.csv"
    path.write_text("time,forward\n0,0\n1,1\n")
    assert isinstance(open_source("sprint", top_speed=8.0), SprintSource)
    assert isinstance(open_source("sprint-raw", top_speed=8.0), SprintSource)
    assert isinstance(open_source(f"profile:{path}", top_speed=8.0), ProfileSource)


@pytest.mark.parametrize("name", ["", "joystick", "profile", "profile:", "sprint:9", "gamepad:"])
def test_unknown_sources_are_refused(name):
    with pytest.raises(InvalidValueError, match="source"):
        open_source(name, top_speed=8.0)


@pytest.mark.parametrize("wrong", [{"top_speed": -1.0}, {"top_speed": 8.0, "distance": 0.0}])
def test_impossible_sprints_are_refused(wrong):
    with pytest.raises(InvalidValueError):
        open_source("sprint", **wrong)
