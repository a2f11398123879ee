"""``sprintlab robot new``: the commands of the tutorial."""

import json
from pathlib import Path

import pytest

GO1 = Path(__file__).parents[2] / "examples" / "go1"


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
    assert "next: sprintlab robot show robots/mydog; sprintlab train robots/mydog" in made.out
    listed = call("robot", "list")
    assert listed.out.split() == ["bp2", "bp2-strong", "bp2-waist", "bp2-weak", "go1", "go2", "mydog"]
    shown = call("robot", "show", "mydog", "--json")
    values = {row["quantity"]: row["value"] for row in json.loads(shown.out)}
    assert values["thigh.length"] == 0.213
    assert values["joint.knee.default_angle"] == -1.8
    assert call("robot", "show", "robots/mydog").status == 0
    envelope = call("motor", "envelope", "mydog", "knee", "--points", 3, "--json")
    assert envelope.status == 0
