"""docs/motor-workbench.md: its commands run in order, and print what the page says they print."""

import json
import re
import shlex
import shutil
from pathlib import Path

import numpy as np
import pytest

from sprintlab.cli.main import main

ROOT = Path(__file__).resolve().parents[2]
TEXT = (ROOT / "docs" / "motor-workbench.md").read_text(encoding="utf-8")
SHEET = "examples/motors/maxon-ec-45-flat-70w.toml"
FENCE = re.compile(r"^```(\w*)\n(.*?)^```", re.MULTILINE | re.DOTALL)


def words(line):
    return " ".join(line.split())


def steps():
    """``(commands, printed lines)``: a shell block, and the text block that follows it if one does."""
    blocks = [(found.start(), *found.groups()) for found in FENCE.finditer(TEXT)]
    for (_, language, body), (_, following, printed) in zip(blocks, [*blocks[1:], (0, "", "")], strict=True):
        if language == "sh":
            shown = printed.splitlines() if following == "text" else []
            yield body.splitlines(), [words(line) for line in shown]


@pytest.fixture
def workplace(tmp_path, monkeypatch):
    """The repository's examples, and the race that the page names."""
    shutil.copytree(ROOT / "examples" / "motors", tmp_path / "examples" / "motors")
    for run in re.findall(r"runs/race-[\d-]+", TEXT):
        (tmp_path / run).mkdir(parents=True, exist_ok=True)
        joints = {name: np.zeros((5, 12)) for name in ("joint_velocity", "joint_torque")}
        np.savez(tmp_path / run / "trajectory.npz", **joints)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_every_command_of_the_page_prints_what_the_page_shows(workplace, capsys):
    count = 0
    for commands, shown in steps():
        output, status = "", 0
        for command in commands:
            program, *arguments = shlex.split(command)
            assert program == "sprintlab"
            status = main(arguments)
            captured = capsys.readouterr()
            output += captured.out + captured.err
            count += 1
        refused = any(line.startswith("sprintlab:") for line in shown)
        assert status == (2 if refused else 0), (commands, output)
        printed = {words(line) for line in output.splitlines()}
        assert set(shown) <= printed, commands
    assert count == 8
    for name in ("my-motor.toml", "envelope.png", "operating.png", "found.toml", "fit.png"):
        assert (workplace / name).stat().st_size > 0


def test_the_unit_mistake_is_told_as_the_page_says(workplace, capsys):
    bench = workplace / "examples" / "motors" / "bench.csv"
    bench.write_text(bench.read_text().replace("speed [rad/s]", "speed [rpm]"))
    assert main(["motor", "identify", str(bench), "--pole-pairs", "21"]) == 2
    assert capsys.readouterr().err in TEXT


def test_the_shown_sheet_and_bench_are_the_shipped_ones():
    blocks = FENCE.findall(TEXT)
    sheet = next(body for language, body in blocks if language == "toml")
    shipped = (ROOT / SHEET).read_text(encoding="utf-8")
    assert {words(line) for line in sheet.splitlines()} <= {
        words(line.split("#")[0]) for line in shipped.splitlines()
    }
    bench = next(body for language, body in blocks if body.startswith("speed [rad/s]"))
    assert bench in (ROOT / "examples" / "motors" / "bench.csv").read_text(encoding="utf-8")


def test_the_share_that_the_text_names_is_computed(workplace, capsys):
    assert main(["motor", "from-datasheet", SHEET, "--out", "my-motor.toml"]) == 0
    capsys.readouterr()
    assert main(["motor", "envelope", "my-motor.toml", "--bus-voltage", "24", "--json"]) == 0
    cost = json.loads(capsys.readouterr().out)["d_axis_cost"][1]
    assert cost["share"] == 0.75
    assert f"promises {cost['torque_without'] / cost['torque'] - 1.0:.0%}".replace("%", " %") in TEXT


def test_python_of_the_page_runs(workplace):
    assert main(["motor", "from-datasheet", SHEET, "--out", "my-motor.toml"]) == 0
    block = next(body for language, body in FENCE.findall(TEXT) if language == "python")
    names = {}
    exec(compile(block, "motor-workbench.md", "exec"), names)
    assert names["lower"] < 0 < names["upper"]
