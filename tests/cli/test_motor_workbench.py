"""``motor from-datasheet`` and ``motor identify`` on the shipped examples and on bad input."""

import json
import re
import runpy
import shutil
from pathlib import Path

import pytest

from sprintlab.core.errors import InvalidValueError
from sprintlab.motors import load_motor
from sprintlab.workbench.datasheet_file import ENTRIES, load_datasheet

EXAMPLES = Path(__file__).parents[2] / "examples" / "motors"
SHEET = EXAMPLES / "maxon-ec-45-flat-70w.toml"


@pytest.fixture
def refused(call):
    """Run a command that must be refused in one sentence; returns the sentence."""

    def run(*arguments):
        outcome = call(*arguments)
        assert outcome.status == 2 and outcome.out == "", outcome
        assert len(outcome.err.strip().splitlines()) == 1
        return outcome.err

    return run


def answer(call, *arguments):
    outcome = call(*arguments, "--json")
    assert outcome.err == ""
    return json.loads(outcome.out)


def test_data_sheet_to_motor_file_to_picture(call, tmp_path):
    motor = tmp_path / "maxon.toml"
    found = answer(call, "motor", "from-datasheet", SHEET, "--output", motor)
    assert found["motor"]["stator_resistance"] == pytest.approx(0.573 / 2)
    assert found["motor"]["pole_pairs"] == 8
    assert load_motor(motor).flux_linkage == found["motor"]["flux_linkage"]
    assert "# R from resistance (lines): R_lines / 2 = 0.573 / 2 = 0.2865 ohm" in motor.read_text()
    shown = answer(call, "motor", "envelope", motor, "--bus-voltage", 24, "--figure", tmp_path / "maxon.png")
    # The catalogue's 5600 rpm at 24 V are 586 rad/s, with all the voltage and friction.
    assert shown["no_load_speed"] == pytest.approx(586 * 0.95, rel=0.02)
    assert (tmp_path / "maxon.png").stat().st_size > 10_000


def test_the_steps_are_printed(call):
    outcome = call("motor", "from-datasheet", SHEET)
    assert outcome.status == 0
    for text in (
        "R_lines / 2",
        "0.573 / 2",
        "psi, taken from kv",
        "note: the sheet says nothing of saturation",
    ):
        assert text in outcome.out


def test_published_contradiction_is_named(refused, call, tmp_path):
    """The firmware's torque constant is 17 % below what its own flux linkage gives."""
    sheet = EXAMPLES / "mini-cheetah-firmware.toml"
    message = refused("motor", "from-datasheet", sheet, "--output", tmp_path / "motor.toml")
    for text in ("torque_constant", "flux_linkage", "-17.0%", "flux_from"):
        assert text in message
    assert list(tmp_path.iterdir()) == []
    settled = tmp_path / "sheet.toml"
    settled.write_text(sheet.read_text() + 'flux_from = "flux_linkage"\n')
    assert answer(call, "motor", "from-datasheet", settled)["motor"]["flux_linkage"] == 2.87e-3


def test_the_template_becomes_a_sheet(call, tmp_path):
    text = call("motor", "from-datasheet", "--template").out
    first, *lines = text.replace('"0 ', '"1 ').splitlines()
    bare = [line.removeprefix("# ") for line in lines]
    chosen = [re.sub(r'"\?"(.*?: )(.*?)(, .*)?$', r'"\2"\1', line) for line in bare]
    sheet = tmp_path / "sheet.toml"
    sheet.write_text("\n".join([first, *chosen]))
    read = load_datasheet(sheet)
    assert set(read.entries) == set(ENTRIES)
    assert read.connection == "star" and read.flux_from == "kv" and read.gear_ratio == 6.0
    sheet.write_text("\n".join([first, *bare]))
    with pytest.raises(InvalidValueError, match="between = '\\?'"):
        load_datasheet(sheet)


def test_motor_and_supply_do_not_go_into_one_file(refused, tmp_path):
    names = (tmp_path / "motor.toml", tmp_path / "." / "motor.toml")
    message = refused("motor", "from-datasheet", SHEET, "--output", names[0], "--supply-output", names[1])
    assert "supply_out" in message and not names[0].exists()


def test_bad_sheets_are_refused(refused, tmp_path):
    assert "tolerance" in refused("motor", "from-datasheet", SHEET, "--tolerance", 0.9)
    unclear = tmp_path / "unclear.toml"
    unclear.write_text(SHEET.read_text().replace(', between = "lines"', ""))
    assert "resistance = '0.573 ohm' does not say which" in refused("motor", "from-datasheet", unclear)


def test_the_shipped_benches_are_what_the_script_writes(tmp_path, capsys):
    script = shutil.copy(EXAMPLES / "make_bench.py", tmp_path)
    runpy.run_path(str(script), run_name="__main__")
    assert "62.66 A" in capsys.readouterr().out
    for name in ("bench.csv", "torque-current.csv", "bench-motor.toml"):
        assert (tmp_path / name).read_text() == (EXAMPLES / name).read_text(), name


def test_identify_recovers_the_motor_of_the_shipped_bench(call, tmp_path):
    arguments = ("motor", "identify", EXAMPLES / "bench.csv", "--pole-pairs", 21, "--peak-current", 62.66)
    files = ("--output", tmp_path / "found.toml", "--rotor-inertia", 5.5e-4, "--figure", tmp_path / "fit.png")
    found = answer(call, *arguments, *files)
    assert found["trustworthy"] and found["outlier_lines"] == []
    truth = load_motor(EXAMPLES / "bench-motor.toml")
    for name in ("stator_resistance", "q_axis_inductance", "flux_linkage", "saturation"):
        parameter = found["parameters"][name]
        assert parameter["determined"]
        assert abs(parameter["value"] - getattr(truth, name)) < 2 * parameter["half_width_95"], name
    motor = load_motor(tmp_path / "found.toml")
    assert motor.peak_torque == pytest.approx(truth.peak_torque, rel=0.01)
    assert (tmp_path / "fit.png").read_bytes().startswith(b"\x89PNG")


def test_identify_prints_intervals_and_fit(call):
    outcome = call("motor", "identify", EXAMPLES / "bench.csv", "--base", EXAMPLES / "bench-motor.toml")
    assert outcome.status == 0
    for text in ("95 % interval", "stator_resistance", "voltage_utilization", "explained"):
        assert text in outcome.out


def test_identify_saturation_from_a_torque_current_table(call, tmp_path):
    table = EXAMPLES / "torque-current.csv"
    options = ("--saturation-only", "--pole-pairs", 21, "--peak-current", 62.66)
    found = answer(call, "motor", "identify", table, *options, "--figure", tmp_path / "fit.png")
    saturation = found["parameters"]["saturation"]
    assert abs(saturation["value"] - 0.15) < 2 * saturation["half_width_95"]
    assert found["parameters"]["stator_resistance"]["value"] is None
    assert found["torque_constant"] == pytest.approx(1.5 * 21 * 6.08e-3, rel=0.01)
    text = call("motor", "identify", table, *options).out
    assert "not determined: needs vq or power" in text


def test_what_was_set_aside_and_not_read_is_told(call, tmp_path):
    lines = (EXAMPLES / "bench.csv").read_text().splitlines()
    lines[1] += ",operator"
    lines[2:] = [f"{line},7" for line in lines[2:]]
    cells = lines[10].split(",")
    cells[2] = "44"
    lines[10] = ",".join(cells)
    (tmp_path / "bench.csv").write_text("\n".join(lines))
    outcome = call("motor", "identify", tmp_path / "bench.csv", "--base", EXAMPLES / "bench-motor.toml")
    assert outcome.status == 0
    assert "outliers in lines 11" in outcome.out and "columns not read: operator" in outcome.out


def test_a_bench_that_the_model_does_not_describe_ends_with_1(call, refused, tmp_path):
    lines = (EXAMPLES / "torque-current.csv").read_text().splitlines()
    lines[2:] = [f"{line.split(',')[0]},{3 + (number % 3)}" for number, line in enumerate(lines[2:])]
    (tmp_path / "table.csv").write_text("\n".join(lines))
    options = ("--saturation-only", "--pole-pairs", 21, "--peak-current", 62.66)
    outcome = call("motor", "identify", tmp_path / "table.csv", *options)
    assert outcome.status == 1 and "no description" in outcome.out
    refused("motor", "identify", tmp_path / "table.csv", *options, "--output", tmp_path / "motor.toml")
    assert not (tmp_path / "motor.toml").exists()


def test_bad_benches_are_refused(refused, tmp_path):
    bench = EXAMPLES / "bench.csv"
    assert "pole_pairs" in refused("motor", "identify", bench)
    assert "'speed [rad/s]'" in refused(
        "motor", "identify", EXAMPLES / "torque-current.csv", "--pole-pairs", 21
    )
    rpm = tmp_path / "rpm.csv"
    rpm.write_text(bench.read_text().replace("speed [rad/s]", "speed [rpm]"))
    assert "the speed is in rad/s, its header says rpm" in refused(
        "motor", "identify", rpm, "--pole-pairs", 21
    )
    assert "rotor" in refused(
        "motor", "identify", bench, "--pole-pairs", 21, "--output", tmp_path / "motor.toml"
    )
    assert "hold" in refused("motor", "identify", bench, "--pole-pairs", 21, "--hold", "friction")
    assert "pole_pairs = 0" in refused("motor", "identify", bench, "--pole-pairs", 0)


@pytest.mark.usefixtures("full_disk")
def test_what_was_identified_is_not_lost_with_the_motor_file(call, tmp_path):
    bench = (EXAMPLES / "bench.csv", "--base", EXAMPLES / "bench-motor.toml")
    files = ("--output", tmp_path / "found.toml", "--figure", tmp_path / "fit.png")
    outcome = call("motor", "identify", *bench, *files)
    assert outcome.status == 2 and "found.toml: No space left on device" in outcome.err
    assert "stator_resistance" in outcome.out and "motor file" not in outcome.out
