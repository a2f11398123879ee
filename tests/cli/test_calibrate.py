"""``sprintlab calibrate``: what it prints, writes and refuses."""

import json
import tempfile

import pytest

from sprintlab.control import load_policy, shipped_policy
from sprintlab.control.calibration import given_speed, true_speed
from sprintlab.control.pace import PaceContract
from sprintlab.evaluation import calibration
from sprintlab.evaluation.calibration import Rung


@pytest.fixture
def climbed(monkeypatch):
    """A robot that holds nine tenths of what its network is given, and estimates one tenth less."""
    asked = []

    def climb(policy, robot, command, settings, contract):
        tables = contract.calibration
        asked.append((command, contract))
        given = command if tables is None else given_speed(tables, command)
        true, estimated = 0.9 * given, 0.9 * given - 0.1 * given
        if tables is not None:
            estimated = true_speed(tables, estimated)
        return Rung(command=command, held=true, estimated=estimated, true=true)

    monkeypatch.setattr(calibration, "climb", climb)
    return asked


def test_both_ladders_are_printed_and_the_file_is_written(call, climbed, tmp_path):
    output = tmp_path / "calibrated.onnx"
    outcome = call("calibrate", "sprint", output, "--top-speed", 4.5, "--workers", 1)
    assert outcome.status == 0 and str(output) in outcome.out
    rows = {line.split()[0]: line.split() for line in outcome.out.splitlines() if line.strip()[:1].isdigit()}
    assert list(rows) == ["1", "2", "3", "4", "4.5"]
    assert rows["3"] == ["3", "2.70", "-0.30", "-0.30", "3.33", "3.00", "+0.00", "+0.00"]
    assert rows["4.5"][4:6] == ["4.50", "4.05"]  # more than it holds
    assert "up to 4.05 m/s" in outcome.out
    written, shipped = load_policy(output), load_policy(shipped_policy())
    assert written.contract.calibration.given[-1] == 4.5
    assert written.contract.pace == shipped.contract.pace
    assert [contract.calibration is None for _, contract in climbed] == [True] * 5 + [False] * 5


def test_tables_that_are_there_are_measured_anew(call, climbed, tmp_path):
    first, second = tmp_path / "first.onnx", tmp_path / "second.onnx"
    call("calibrate", "sprint", first, "--top-speed", 4, "--workers", 1)
    outcome = call("calibrate", first, second, "--top-speed", 4, "--workers", 1, "--json")
    numbers = json.loads(outcome.out)
    assert second.read_bytes() == first.read_bytes()
    assert numbers["policy"] == "first" and numbers["output"] == str(second)
    assert numbers["largest_speed_error_m_s"]["before"] == pytest.approx(0.3)
    assert numbers["largest_speed_error_m_s"]["after"] == pytest.approx(0.1)  # as at 1 m/s


def test_the_lead_is_that_of_the_calibrated_estimate(call, climbed, tmp_path):
    output = tmp_path / "calibrated.onnx"
    call("calibrate", "go2-sprint", output, "--top-speed", 4, "--lead", 1.5, "--workers", 1)
    assert load_policy(output).contract.pace == PaceContract(lead=1.5)
    climbed.clear()
    call("calibrate", "sprint", tmp_path / "led.onnx", "--top-speed", 4, "--lead", 1.5, "--workers", 1)
    leads = [contract.pace.lead for _, contract in climbed]
    assert leads == [None] * 4 + [1.5] * 4, "an estimate without tables would hold the command back"
    refused = call("calibrate", "sprint", tmp_path / "new.onnx", "--top-speed", 4, "--lead", 0.1)
    assert refused.status == 2 and "pace.lead" in refused.err and not (tmp_path / "new.onnx").exists()


def test_bad_input_is_refused_before_anything_runs(call, policy, climbed, tmp_path):
    output = tmp_path / "calibrated.onnx"
    assert "calibrate.top_speed" in call("calibrate", "sprint", output, "--top-speed", 99).err
    assert "calibrate.top_speed" in call("calibrate", "sprint", output, "--top-speed", 1).err
    assert "estimator" in call("calibrate", policy, output, "--top-speed", 4).err
    assert "gallop" in call("calibrate", "gallop", output, "--top-speed", 4).err
    assert "nodog" in call("calibrate", "sprint", output, "--top-speed", 4, "--robot", "nodog").err
    assert "bp2" in call("calibrate", "sprint", output, "--top-speed", 4, "--robot", "go1").err
    assert "workers" in call("calibrate", "sprint", output, "--top-speed", 4, "--workers", 0).err
    assert "top-speed" in call("calibrate", "sprint", output).err
    output.write_text("mine")
    refused = call("calibrate", "sprint", output, "--top-speed", 4)
    assert refused.status == 2 and "exists already" in refused.err and output.read_text() == "mine"
    assert "is a folder" in call("calibrate", "sprint", tmp_path, "--top-speed", 4).err
    assert "cannot write" in call("calibrate", "sprint", output / "new.onnx", "--top-speed", 4).err
    assert not climbed


@pytest.mark.usefixtures("brief_trials")
def test_a_real_ladder_from_end_to_end(call, tmp_path, monkeypatch):
    keywords = calibration.LadderSettings.__init__.__kwdefaults__
    monkeypatch.setitem(keywords, "hold", 1.0)
    monkeypatch.setitem(keywords, "counted", 0.5)
    output = tmp_path / "calibrated.onnx"
    outcome = call("calibrate", "sprint", output, "--top-speed", 2, "--workers", 1, "--json")
    numbers = json.loads(outcome.out)
    assert [row["command_m_s"] for row in numbers["before"]] == [1.0, 2.0]
    assert all(0.5 < row["held_speed_m_s"] < 2.5 for row in numbers["after"])
    assert load_policy(output).contract.calibration is not None


@pytest.mark.usefixtures("climbed", "full_disk")
def test_what_was_measured_is_not_lost_with_the_file(call, tmp_path, monkeypatch):
    output = tmp_path / "calibrated.onnx"
    outcome = call("calibrate", "sprint", output, "--top-speed", 4, "--workers", 1, "--json")
    assert outcome.status == 2 and "No space left on device" in outcome.err and not output.exists()
    numbers = json.loads(outcome.out)
    assert numbers["output"] is None and len(numbers["calibration"]["given"]) == 4
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "gone"))
    outcome = call("calibrate", "sprint", output, "--top-speed", 4, "--workers", 1)
    assert outcome.status == 2 and f"cannot write {output}" in outcome.err
    assert "Calibration of sprint" in outcome.out and "policy:" not in outcome.out
