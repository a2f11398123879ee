"""Commands that answer: help, tables, JSON."""

import json
import os
import subprocess
import sys

import pytest

from sprintlab.cli import train
from sprintlab.motors import PmsmParameters, save_motor
from sprintlab.robots import load_robot, parameter_table

HEAVY = ("mujoco", "torch", "onnxruntime", "matplotlib", "numpy", "warp")


def test_help_imports_nothing_heavy():
    code = (
        "import sys, sprintlab.cli.main as m\n"
        "try: m.main(['--help'])\n"
        "except SystemExit: pass\n"
        f"print([name for name in {HEAVY} if name in sys.modules], file=sys.stderr)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stderr.strip() == "[]"
    for command in ("race", "evaluate", "robot", "motor", "train", "export", "doctor"):
        assert command in done.stdout


@pytest.mark.parametrize(
    "command", [("race",), ("evaluate",), ("robot", "show"), ("motor", "envelope"), ("export",), ("doctor",)]
)
def test_every_command_has_help(call, command):
    outcome = call(*command, "--help")
    assert outcome.status == 0
    assert "--json" in outcome.out or command == ("export",)


def test_robot_table_has_a_row_for_every_parameter(call):
    rows = json.loads(call("robot", "show", "bp2", "--json").out)
    assert [row["quantity"] for row in rows] == [row.quantity for row in parameter_table("bp2")]
    assert all(row["basis"] and row["unit"] for row in rows)
    assert "thigh.length" in call("robot", "show").out


def test_robot_list(call):
    assert call("robot", "list").out.split() == ["bp2"]
    assert json.loads(call("robot", "list", "--json").out) == ["bp2"]


def test_motor_envelope_ends_without_driving_torque_at_the_no_load_speed(call):
    found = json.loads(call("motor", "envelope", "bp2", "hip", "--points", 5, "--json").out)
    rows = found["rows"]
    hip = load_robot("bp2").motors.peak_torque[1]
    assert len(rows) == 5
    assert rows[0]["refined upper"] == pytest.approx(hip)
    assert rows[-1]["speed"] == pytest.approx(found["no_load_speed"])
    assert rows[-1]["refined upper"] == pytest.approx(0.0, abs=1e-6)
    assert found["critical_speed_refined"] < found["critical_speed_v_d_0"] < found["no_load_speed"]


def test_motor_envelope_of_a_file_draws_a_figure(call, tmp_path):
    motor = PmsmParameters(
        pole_pairs=21,
        stator_resistance=0.1,
        q_axis_inductance=6e-5,
        flux_linkage=6e-3,
        peak_torque=15.0,
        rotor_inertia=7e-4,
    )
    save_motor(motor, tmp_path / "motor.toml")
    picture = tmp_path / "envelope.png"
    outcome = call("motor", "envelope", tmp_path / "motor.toml", "--bus-voltage", 48, "--figure", picture)
    assert outcome.status == 0 and "at 48 V" in outcome.out
    assert picture.read_bytes().startswith(b"\x89PNG")
    shown = json.loads(call("motor", "show", tmp_path / "motor.toml", "--json").out)
    assert shown["motor"]["peak_torque"] == 15.0 and shown["bus_voltage"] == 60.0


def test_doctor_prints_json_only(call, monkeypatch):
    monkeypatch.setenv("MUJOCO_GL", "no-such-backend")
    found = json.loads(call("doctor", "--json").out)
    assert found["mujoco"] and found["OpenGL backend for videos"] is None


def test_piped_output_has_no_colours(call):
    assert "\x1b" not in call("robot", "show").out


def test_the_method_may_stand_alone():
    assert train.method_as_option(["sprint", "--seed", "1"]) == ["--method", "sprint", "--seed", "1"]
    assert train.method_as_option(["--method", "sprint"]) == ["--method", "sprint"]


def test_a_reader_that_leaves_early_is_no_error():
    shell = f"{sys.executable} -m sprintlab.cli.main robot show | head -1; exit ${{PIPESTATUS[0]}}"
    done = subprocess.run(["bash", "-c", shell], capture_output=True, text=True, env=os.environ, check=False)
    assert done.returncode == 0 and "Traceback" not in done.stderr
