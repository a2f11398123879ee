"""``sprintlab robot new``: the commands of the tutorial, and bad input."""

import json
from pathlib import Path

import pytest

from sprintlab.robots.importing import source

GO1 = Path(__file__).parents[2] / "examples" / "go1"
OPTIONS = (
    "--abad-motor", GO1 / "motor.toml", "--hip-motor", GO1 / "motor.toml", "--knee-motor", GO1 / "motor.toml",
    "--abad-gear", 6, "--hip-gear", 6, "--knee-gear", 9, "--bus-voltage", 24,
)  # fmt: skip


@pytest.fixture
def here(tmp_path, monkeypatch):
    """A working directory with the examples of the project in it."""
    (tmp_path / "examples").symlink_to(GO1.parent)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_the_tutorials_commands_make_a_robot(call, here):
    made = call(
        "robot", "new", "examples/go1/go1.xml", "--choices", "examples/go1/choices.toml", "--name", "mydog"
    )
    assert made.status == 0
    assert "inertia matrix" in made.out and "written: robots/mydog/" in made.out
    assert "next: sprintlab robot show robots/mydog; python robots/mydog/train.py" in made.out
    listed = call("robot", "list")
    assert listed.out.split() == ["bp2", "bp2-strong", "bp2-waist", "bp2-weak", "go1", "go2", "mydog"]
    shown = call("robot", "show", "mydog", "--json")
    values = {row["quantity"]: row["value"] for row in json.loads(shown.out)}
    assert values["thigh.length"] == 0.213
    assert values["joint.knee.default_angle"] == -1.8
    assert call("robot", "show", "robots/mydog").status == 0
    envelope = call("motor", "envelope", "mydog", "knee", "--points", 3, "--json")
    assert envelope.status == 0


def test_options_alone_are_enough(call, here, monkeypatch):
    compilations = []
    compiled = source.compiled
    monkeypatch.setattr(source, "compiled", lambda path: compilations.append(path) or compiled(path))
    made = call("robot", "new", GO1 / "go1.xml", *OPTIONS, "--json")
    assert made.status == 0
    assert len(compilations) == 1  # each may take seven seconds
    answer = json.loads(made.out)
    assert answer["robot"] == "go1"
    assert {check["what"] for check in answer["checks"]} >= {"mass", "inertia matrix", "feet", "limits"}
    assert (here / "robots" / "go1" / "train.py").is_file()


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (("none.xml", *OPTIONS), "cannot read robot model none.xml"),
        ((GO1 / "go1.xml", *OPTIONS[:-2]), "not given: --bus-voltage; a file of --choices"),
        ((GO1 / "go1.xml", *OPTIONS[2:]), "not given: --abad-motor; a file"),
        (
            (GO1 / "go1.xml", "--abad-gear", 6),
            "not given: --bus-voltage, --abad-motor, --hip-motor, --hip-gear,",
        ),
        ((GO1 / "go1.xml", *OPTIONS[:-1], -5), "bus_voltage = -5.0"),
        ((GO1 / "go1.xml", *OPTIONS, "--name", "../x"), "name = '../x'"),
        ((GO1 / "go1.xml", *OPTIONS, "--hip-motor", "none.toml"), "cannot read motor file none.toml"),
        (
            (GO1 / "go1.xml", *OPTIONS, "--hip-motor", "ak80"),
            "ROBOT:JOINT such as bp2:hip, or one of cubemars",
        ),
        ((GO1 / "motor.toml", *OPTIONS), "cannot be used"),
        ((GO1 / "go1.xml", "--choices", "none.toml"), "cannot read choices none.toml"),
    ],
)
def test_bad_input_is_refused_with_one_sentence(call, here, arguments, sentence):
    refused = call("robot", "new", *arguments)
    assert refused.status == 2
    assert sentence in refused.err
    assert refused.err.count("\n") == 1
    assert not (here / "robots").exists()
