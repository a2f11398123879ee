"""``sprintlab motor envelope``, ``show`` and ``library``."""

import json
from pathlib import Path

import numpy as np
import pytest

import sprintlab as sl
from sprintlab.core.errors import SprintlabError
from sprintlab.motors import (
    MOTOR_MODELS,
    PmsmParameters,
    library_motors,
    load_library_motor,
    load_motor,
    save_motor,
)
from sprintlab.robots import load_robot

EXAMPLES = Path(__file__).parents[2] / "examples" / "motors"


@pytest.fixture
def motor_file(tmp_path):
    motor = PmsmParameters(
        pole_pairs=21,
        stator_resistance=0.1,
        q_axis_inductance=6e-5,
        flux_linkage=6e-3,
        peak_torque=15.0,
        saturation=0.1,
        rotor_inertia=7e-4,
    )
    save_motor(motor, tmp_path / "motor.toml")
    return tmp_path / "motor.toml"


@pytest.fixture
def trajectory(tmp_path):
    """Two samples of 12 joints: at rest, and the hips at 10 rad/s with 40 N m."""
    speed, torque = np.zeros((2, 12)), np.zeros((2, 12))
    speed[1, 1::3], torque[1, 1::3] = 10.0, 40.0
    np.savez(tmp_path / "trajectory.npz", joint_velocity=speed, joint_torque=torque)
    return tmp_path / "trajectory.npz"


def envelope(call, *arguments):
    outcome = call("motor", "envelope", *arguments, "--json")
    assert outcome.status == 0, outcome.err
    return json.loads(outcome.out)


def test_envelope_is_on_the_joint_side_and_ends_at_the_no_load_speed(call):
    found = envelope(call, "bp2", "hip", "--points", 5)
    robot = load_robot("bp2")
    peak = robot.motors.peak_torque[1] * robot.gear.ratio[1]  # at rest a gear takes nothing
    rows = found["rows"]
    assert len(rows) == 5
    assert rows[0]["refined upper"] == pytest.approx(peak)
    assert rows[-1]["square upper"] == pytest.approx(peak * robot.gear.efficiency[1])
    assert rows[0]["refined + saturation upper"] == pytest.approx(peak * (1 - robot.motors.saturation[1]))
    assert rows[-1]["speed"] == pytest.approx(found["no_load_speed"])
    assert rows[-1]["refined upper"] == pytest.approx(0.0, abs=1e-6)
    critical = found["critical_speed"]
    assert critical["refined"] < critical["simplified-dc"] < found["no_load_speed"]
    assert critical["square"] is None


def test_every_model_has_its_columns_and_power(call, motor_file):
    found = envelope(call, motor_file, "--bus-voltage", 60, "--points", 2)
    names = {*MOTOR_MODELS, "refined + saturation"}
    assert set(found["rows"][0]) == {
        "speed",
        *(f"{name} {end}" for name in names for end in ("lower", "upper")),
    }
    assert set(found["peak_power"]) == names
    power = found["peak_power"]
    assert (
        power["refined + saturation"]["power"] < power["refined"]["power"] < power["simplified-dc"]["power"]
    )


def test_the_gear_moves_torque_and_speed(call, motor_file):
    alone = envelope(call, motor_file, "--bus-voltage", 60, "--points", 2)
    geared = envelope(
        call, motor_file, "--bus-voltage", 60, "--points", 2, "--gear-ratio", 6, "--gear-efficiency", 0.9
    )
    assert geared["no_load_speed"] == pytest.approx(alone["no_load_speed"] / 6)
    resting, driving = (row["square upper"] for row in geared["rows"])
    peak = alone["rows"][0]["square upper"]
    assert resting == pytest.approx(6.0 * peak) and driving == pytest.approx(5.4 * peak)
    assert geared["peak_power"]["refined"]["power"] == pytest.approx(
        0.9 * alone["peak_power"]["refined"]["power"]
    )


def test_an_actuator_of_the_library_comes_with_gear_and_bus(call):
    found = envelope(call, "mit-mini-cheetah", "--points", 2)
    assert found["gear"] == {"ratio": 6.0, "efficiency": 1.0} and found["bus_voltage"] == 24.0
    assert found["rows"][0]["refined upper"] == pytest.approx(18.0)
    assert envelope(call, "mit-mini-cheetah", "--gear-ratio", 9.33)["gear"]["ratio"] == 9.33


def test_the_d_axis_costs_nothing_while_the_peak_torque_fits(call):
    half, *faster = envelope(call, "bp2", "hip")["d_axis_cost"]
    assert [half["share"], *(cost["share"] for cost in faster)] == [0.5, 0.75, 0.9]
    assert half["lost"] == pytest.approx(0.0, abs=1e-12)
    assert all(0.1 < cost["lost"] < 0.5 and 0.0 < cost["voltage_share"] < 1.0 for cost in faster)


def test_tables_and_figure(call, motor_file, tmp_path):
    picture = tmp_path / "envelope.png"
    outcome = call("motor", "envelope", motor_file, "--bus-voltage", 48, "--figure", picture)
    assert outcome.status == 0 and "at 48 V" in outcome.out
    for text in ("d-axis voltage costs", "no-load speed", "brake", "v_d = 0"):
        assert text in outcome.out
    assert picture.read_bytes().startswith(b"\x89PNG")


def test_operating_points_are_compared_with_every_envelope(call, trajectory, tmp_path):
    picture = tmp_path / "envelope.png"
    points = envelope(call, "bp2", "hip", "--trajectory", trajectory, "--figure", picture)["operating_points"]
    assert points["samples"] == 8  # two samples of four hips
    assert set(points["beyond"].values()) == {0.0}
    assert picture.stat().st_size > 0
    weak = envelope(call, "bp2", "hip", "--trajectory", trajectory, "--gear-efficiency", 0.25)
    assert weak["operating_points"]["beyond"]["refined"] == 0.5
    assert points["at_limit"] == 0.0 and weak["operating_points"]["at_limit"] == 0.5
    one = envelope(call, "bp2", "RL_hip", "--trajectory", trajectory)
    assert one["operating_points"]["samples"] == 2


def test_a_trajectory_that_cannot_be_compared_is_refused(call, tmp_path):
    np.savez(tmp_path / "other.npz", time=np.zeros(3))
    outcome = call("motor", "envelope", "bp2", "hip", "--trajectory", tmp_path / "other.npz")
    assert outcome.status == 2 and len(outcome.err.splitlines()) == 1 and "joint_velocity" in outcome.err


def test_show_is_on_the_motor_side(call, motor_file):
    shown = json.loads(call("motor", "show", motor_file, "--bus-voltage", 60, "--json").out)
    assert shown["motor"]["peak_torque"] == 15.0 and shown["bus_voltage"] == 60.0
    robot = json.loads(call("motor", "show", "bp2", "hip", "--json").out)
    assert robot["no_load_speed"] == pytest.approx(8.25 * envelope(call, "bp2", "hip")["no_load_speed"])


def test_a_data_sheet_stands_for_its_motor(call, tmp_path):
    sheet = EXAMPLES / "maxon-ec-45-flat-70w.toml"
    assert call("motor", "from-datasheet", sheet, "--output", tmp_path / "motor.toml").status == 0
    files = (sheet, tmp_path / "motor.toml")
    of_sheet, of_motor = (sl.chosen_motor(str(path), bus_voltage=24.0) for path in files)
    numbers = of_sheet.to_dict()
    assert numbers["motor"] == pytest.approx(of_motor.to_dict()["motor"], rel=1e-4)
    assert f"{numbers['no_load_speed']:.5g}" in str(of_sheet)


def test_the_library_names_every_number_with_its_source(call, tmp_path):
    entries = json.loads(call("motor", "library", "--json").out)
    assert [entry["name"] for entry in entries] == list(library_motors())
    assert all(name in call("motor", "library").out for name in library_motors())
    for entry in entries:
        assert all(value["source"] for value in entry["values"].values())
        assert 0 < entry["joint"]["corner_speed"] < entry["joint"]["no_load_speed"]
    u12 = next(entry["joint"] for entry in entries if entry["name"] == "mit-humanoid-u12")
    assert u12["corner_speed"] == pytest.approx(24.5, abs=0.05)
    assert u12["corner_lost_to_v_d"] == pytest.approx(0.186, abs=0.001)
    out = call("motor", "library", "xiaomi-cybergear").out
    assert "CyberGear micro motor user manual" in " ".join(out.split()) and "estimated" in out
    files = ("--save", tmp_path / "u12.toml", "--figure", tmp_path / "library.png")
    assert call("motor", "library", "mit-humanoid-u12", *files).status == 0
    assert load_motor(tmp_path / "u12.toml") == load_library_motor("mit-humanoid-u12").motor
    assert (tmp_path / "library.png").stat().st_size > 30_000


def test_a_picture_that_finds_no_room_takes_no_numbers_with_it(call, tmp_path, monkeypatch):
    def full(path, figure):
        raise SprintlabError(f"{path} cannot be written: No space left on device")

    monkeypatch.setattr("sprintlab.core.theme.save_figure", full)
    outcome = call("motor", "envelope", "--figure", tmp_path / "envelope.png", "--json")
    assert outcome.status == 2 and "No space left on device" in outcome.err
    assert json.loads(outcome.out)["figure"].endswith("envelope.png")
