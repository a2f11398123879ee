"""``sprintlab motor``: envelope, show, library, from-datasheet and identify on the shipped examples."""

import json
import re
import runpy
import shutil
from pathlib import Path

import pytest

from sprintlab.core.errors import InvalidValueError
from sprintlab.motors import MOTOR_MODELS, library_motors, load_library_motor, load_motor
from sprintlab.robots import load_robot
from sprintlab.workbench.datasheet_file import ENTRIES, load_datasheet

EXAMPLES = Path(__file__).parents[2] / "examples" / "motors"
TABLE = (EXAMPLES / "torque-current.csv", "--saturation-only", "--pole-pairs", 21, "--peak-current", 62.66)


@pytest.fixture
def answer(call):
    """The JSON that a command of ``motor`` prints."""

    def run(*words):
        outcome = call("motor", *words, "--json")
        assert outcome.status == 0 and outcome.err == "", outcome.err
        return json.loads(outcome.out)

    return run


def test_an_envelope_is_on_the_joint_side_and_ends_at_the_no_load_speed(answer):
    found, robot = answer("envelope", "bp2", "hip", "--points", 5), load_robot("bp2")
    peak = robot.motors.peak_torque[1] * robot.gear.ratio[1]  # at rest a gear takes nothing
    rows, critical = found["rows"], found["critical_speed"]
    assert len(rows) == 5 and rows[0]["refined upper"] == pytest.approx(peak)
    assert rows[-1]["square upper"] == pytest.approx(peak * robot.gear.efficiency[1])
    assert rows[0]["refined + saturation upper"] == pytest.approx(peak * (1 - robot.motors.saturation[1]))
    assert rows[-1]["speed"] == pytest.approx(found["no_load_speed"])
    assert rows[-1]["refined upper"] == pytest.approx(0.0, abs=1e-6)
    assert critical["refined"] < critical["simplified-dc"] < found["no_load_speed"]
    assert critical["square"] is None and set(found["peak_power"]) == {*MOTOR_MODELS, "refined + saturation"}
    half, *faster = found["d_axis_cost"]
    assert half["lost"] == pytest.approx(0.0, abs=1e-12) and all(0.1 < each["lost"] < 0.5 for each in faster)
    shown = answer("show", "bp2", "hip")
    assert shown["no_load_speed"] == pytest.approx(8.25 * found["no_load_speed"])


def test_the_library_names_every_number_with_its_source(call, answer, tmp_path):
    entries = {entry["name"]: entry for entry in answer("library")}
    assert list(entries) == list(library_motors())
    assert entries["mit-humanoid-u12"]["lost"] == pytest.approx(0.186, abs=0.001)
    out = call("motor", "library", "xiaomi-cybergear").out
    assert "CyberGear micro motor user manual" in " ".join(out.split()) and "estimated" in out
    files = ("--save", tmp_path / "u12.toml", "--figure", tmp_path / "library.png")
    assert call("motor", "library", "mit-humanoid-u12", *files).status == 0
    assert load_motor(tmp_path / "u12.toml") == load_library_motor("mit-humanoid-u12").motor
    assert (tmp_path / "library.png").stat().st_size > 30_000


def test_the_template_becomes_a_sheet(call, tmp_path):
    first, *lines = call("motor", "from-datasheet", "--template").out.replace('"0 ', '"1 ').splitlines()
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


def test_the_shipped_benches_are_what_the_script_writes(tmp_path, capsys):
    runpy.run_path(str(shutil.copy(EXAMPLES / "make_bench.py", tmp_path)), run_name="__main__")
    assert "62.66 A" in capsys.readouterr().out
    for name in ("bench.csv", "torque-current.csv", "bench-motor.toml"):
        assert (tmp_path / name).read_text() == (EXAMPLES / name).read_text(), name


def test_a_fit_that_does_not_describe_its_data_has_status_1_and_writes_no_motor(call, tmp_path):
    lines = TABLE[0].read_text().splitlines()
    lines[2:] = [f"{line.split(',')[0]},{3 + (number % 3)}" for number, line in enumerate(lines[2:])]
    (tmp_path / "table.csv").write_text("\n".join(lines))
    outcome = call("motor", "identify", tmp_path / "table.csv", *TABLE[1:])
    assert outcome.status == 1 and "no description" in outcome.out
    outcome = call("motor", "identify", tmp_path / "table.csv", *TABLE[1:], "--output", tmp_path / "m.toml")
    assert outcome.status == 2 and not (tmp_path / "m.toml").exists()
