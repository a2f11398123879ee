"""Commands that answer: help, tables, JSON."""

import json
import os
import subprocess
import sys
from importlib import metadata

import pytest

from sprintlab.cli import train
from sprintlab.robots import parameter_table

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


def test_the_version_is_that_of_the_package(call):
    assert call("--version") == (0, f"sprintlab {metadata.version('sprintlab')}\n", "")


def test_robot_list(call):
    names = ["bp2", "bp2-strong", "bp2-waist", "bp2-weak", "go1", "go2"]
    assert call("robot", "list").out.split() == names
    assert json.loads(call("robot", "list", "--json").out) == names


def test_names_of_strangers_robots_are_shown_and_not_obeyed(call, tmp_path, monkeypatch):
    for name in ("a\x1b[2Jb", "\u202egnp", "two\nlines"):
        (tmp_path / "robots" / name).mkdir(parents=True)
        (tmp_path / "robots" / name / "parameters.toml").touch()
    monkeypatch.chdir(tmp_path)
    assert set(call("robot", "list").out.splitlines()) > {r"a\x1b[2Jb", r"\u202egnp", r"two\nlines"}


def test_piped_output_has_no_colours(call):
    assert "\x1b" not in call("robot", "show").out


def test_the_method_may_stand_alone():
    assert train.method_as_option(["sprint", "--seed", "1"]) == ["--method", "sprint", "--seed", "1"]
    assert train.method_as_option(["--method", "sprint"]) == ["--method", "sprint"]


def test_a_reader_that_leaves_early_is_no_error():
    shell = f"{sys.executable} -m sprintlab.cli.main robot show | head -1; exit ${{PIPESTATUS[0]}}"
    done = subprocess.run(["bash", "-c", shell], capture_output=True, text=True, env=os.environ, check=False)
    assert done.returncode == 0 and "Traceback" not in done.stderr


def test_the_package_runs_as_a_module():
    words = [sys.executable, "-m", "sprintlab", "robot", "show", "nobody"]
    done = subprocess.run(words, capture_output=True, text=True)
    assert done.returncode == 2 and "'nobody'" in done.stderr
