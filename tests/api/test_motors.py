"""Motors from Python: what ``sprintlab motor`` and ``sprintlab audit`` print, as objects."""

import json
from pathlib import Path

import numpy as np
import pytest

import sprintlab as sl
from sprintlab.api.motors import chosen_motor
from sprintlab.cli.main import main
from sprintlab.core.errors import SprintlabError
from sprintlab.motors import load_motor
from sprintlab.workbench.datasheet import convert_datasheet, save_converted_motor
from sprintlab.workbench.datasheet_file import load_datasheet

BENCHES = Path(__file__).resolve().parents[2] / "examples" / "motors"


@pytest.fixture
def printed(capsys):
    """The JSON that a command prints."""

    def run(*words):
        assert main([*map(str, words), "--json"]) == 0
        return json.loads(capsys.readouterr().out)

    return run


@pytest.fixture
def rollout(tmp_path):
    """Hips asked for 100 N m at 24 rad/s, half of the time."""
    speed, torque = np.zeros((20, 12)), np.zeros((20, 12))
    speed[10:, 1::3], torque[10:, 1::3] = 24.0, 100.0
    path = tmp_path / "rollout.npz"
    np.savez(path, time=np.arange(20) * 0.02, joint_velocity=speed, joint_torque=torque)
    return path


def test_a_motor_has_the_numbers_of_its_command(printed):
    motor = sl.chosen_motor("bp2", "knee", gear_ratio=1.0, gear_efficiency=1.0)
    assert motor.to_dict() == printed("motor", "show", "bp2", "knee")
    assert f"{motor.speeds()['no_load_speed']:.5g}" in str(motor) and "bp2 knee motor at 60 V" in str(motor)
    with pytest.raises(sl.SprintlabError, match="tail"):
        sl.chosen_motor("bp2", "tail")


def test_an_envelope_has_the_numbers_of_its_command_and_draws_itself(printed, rollout):
    found = sl.envelope("bp2", "hip", trajectory=rollout, points=3)
    numbers = printed("motor", "envelope", "bp2", "hip", "--trajectory", rollout, "--points", 3)
    assert json.loads(json.dumps({**found.to_dict(), "figure": None})) == numbers
    assert numbers["operating_points"]["samples"] == 4 * 20
    assert "Operating points of the trajectory" in str(found)
    assert "Operating points" not in str(sl.envelope("bp2", "hip"))
    assert found.plot()._repr_png_().startswith(b"\x89PNG")
    with pytest.raises(sl.SprintlabError, match="points"):
        sl.envelope(points=1)


def test_actuators_compare_all_or_name_the_sources_of_one(printed):
    found = sl.actuators()
    assert list(found.to_dict().values()) == printed("motor", "library")
    assert all(name in str(found) for name in found.to_dict())
    one = sl.actuators("mit-mini-cheetah")
    assert list(one.to_dict()) == ["mit-mini-cheetah"] and "source" in str(one)
    with pytest.raises(sl.SprintlabError, match="mit-mini-cheetah"):
        sl.actuators("mit-maxi-cheetah")


def test_a_bench_becomes_a_motor_file(printed, tmp_path):
    pytest.importorskip("scipy")
    bench, base = BENCHES / "bench.csv", BENCHES / "bench-motor.toml"
    found = sl.identify_motor(bench, base=base)
    assert {**found.to_dict(), "figure": None} == printed("motor", "identify", bench, "--base", base)
    assert found.trustworthy and "flux_linkage" in str(found)
    found.save(tmp_path / "motor.toml")
    written = sl.identify_motor(bench, base=base, output=tmp_path / "same.toml", rotor_inertia=1e-4)
    assert f"motor file: {tmp_path / 'same.toml'}" in str(written) and "motor file" not in str(found)
    assert load_motor(tmp_path / "same.toml").rotor_inertia == 1e-4
    flux = found.to_dict()["parameters"]["flux_linkage"]["value"]
    assert load_motor(tmp_path / "motor.toml").flux_linkage == pytest.approx(flux)
    with pytest.raises(sl.SprintlabError, match="pole_pairs"):
        sl.identify_motor(bench)


def test_a_rollout_is_audited(printed, rollout):
    found = sl.audit_rollout(rollout, "bp2")
    assert json.loads(json.dumps({**found.to_dict(), "figure": None})) == printed(
        "audit", rollout, "--motor", "bp2"
    )
    assert [joint.name for joint in found.verdict.joints if joint.impossible == 0.5] == [
        "FL_hip", "FR_hip", "RL_hip", "RR_hip",
    ]  # fmt: skip
    assert found.verdict.sentence in str(found).replace("\n", " ")
    one = sl.audit_rollout(rollout, "bp2", joint="hip")
    assert one.motors.bus_voltage == 60.0 and np.ndim(one.motors.motor.peak_torque) == 0


def test_a_data_sheet_stands_for_its_motor(tmp_path):
    sheet = load_datasheet(BENCHES / "maxon-ec-45-flat-70w.toml")
    save_converted_motor(convert_datasheet(sheet), sheet, tmp_path / "motor.toml")
    of_sheet, of_motor = (
        chosen_motor(str(path), bus_voltage=24.0)
        for path in (BENCHES / "maxon-ec-45-flat-70w.toml", tmp_path / "motor.toml")
    )
    for name in ("stator_resistance", "q_axis_inductance", "flux_linkage", "peak_torque"):
        assert getattr(of_sheet.drive.motor, name) == pytest.approx(
            getattr(of_motor.drive.motor, name), rel=1e-4
        )


def test_a_file_names_no_bus_so_its_voltage_is_asked_for():
    with pytest.raises(SprintlabError, match="bus_voltage is not given"):
        chosen_motor(str(BENCHES / "maxon-ec-45-flat-70w.toml"))


def test_a_policy_is_no_rollout():
    with pytest.raises(SprintlabError, match="sprintlab race judges a policy"):
        sl.audit_rollout("policy.onnx", "go1")
