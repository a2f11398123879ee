import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sprintlab import robots
from sprintlab.control import load_policy, shipped_policies, shipped_policy
from sprintlab.core.errors import RobotModelError
from sprintlab.robots import (
    load_robot,
    load_robot_file,
    robot_fingerprint,
    robot_names,
)

TABLE = Path(robots.__file__).parent / "bp2" / "parameters.toml"


@pytest.fixture(scope="module")
def bp2():
    return load_robot("bp2")


@pytest.fixture
def edited_table(tmp_path):
    """A function that writes BP2's table with one text replaced by another."""

    def edit(old: str, new: str) -> Path:
        text = TABLE.read_text(encoding="utf-8")
        assert text.count(old) == 1
        path = tmp_path / "robot.toml"
        path.write_text(text.replace(old, new), encoding="utf-8")
        return path

    return edit


def test_robots_of_ones_own_are_found_by_name_and_by_path(tmp_path, monkeypatch, bp2):
    folder = tmp_path / "robots" / "mine"
    folder.mkdir(parents=True)
    text = TABLE.read_text(encoding="utf-8").replace('name = "bp2"', 'name = "mine"')
    (folder / "parameters.toml").write_text(text, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    assert "mine" in robot_names()
    names = ("mine", "robots/mine", str(folder), folder, folder / "parameters.toml")
    assert len({robot_fingerprint(load_robot(name)) for name in names}) == 1
    folder.rename(folder.parent / "bp2")
    assert load_robot("bp2").name == "bp2"  # none hides one of the package
    (folder.parent / "bp2").rename(folder)
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    with pytest.raises(RobotModelError, match=r"'mine' is unknown; known robots: .*bp2"):
        load_robot("mine")
    monkeypatch.setenv("SPRINTLAB_ROBOTS", f"/nowhere{os.pathsep}{folder.parent}")
    assert load_robot("mine").name == "mine"
    with pytest.raises(RobotModelError, match="sprintlab robot new makes one of it"):
        load_robot("a1.urdf")


@pytest.mark.parametrize("name", shipped_policies())
def test_the_robots_of_the_shipped_policies_are_those_that_they_were_trained_on(name):
    """What a shipped policy's contract was made for must not change under it."""
    contract = load_policy(shipped_policy(name)).contract
    assert robot_fingerprint(load_robot(contract.robot_name)) == contract.robot_fingerprint


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("length = { value = 0.31", "long = { value = 0.31", r"unknown quantity thigh\.long"),
        ('value = 0.31, unit = "m"', 'value = 310, unit = "mm"', r"thigh\.length\.unit = 'mm'"),
        ("total_mass = { value = 36.5", "total_mass = { value = 15.0", "must exceed the legs' mass"),
    ],
)
def test_a_broken_table_is_refused_with_what_is_wrong(edited_table, old, new, message):
    path = edited_table(old, new)
    with pytest.raises(RobotModelError, match=message) as caught:
        load_robot_file(path)
    assert str(path) in str(caught.value)


def test_the_fingerprint_follows_numbers_and_not_words(bp2, edited_table):
    for old, new in (
        ("[0.0, -0.02, -0.062]", "[0.0, -0.02, -0.057]"),
        ("value = 0.1163", "value = 0.1164"),
        ('name = "bp2"', 'name = "bp3"'),
    ):
        assert robot_fingerprint(load_robot_file(edited_table(old, new))) != robot_fingerprint(bp2)
    same = load_robot_file(edited_table("BPX ±0.873", "somewhere else"))
    assert robot_fingerprint(same) == robot_fingerprint(bp2)
    height = bp2.standing_height  # the last digit of a cosine differs between machines
    same = replace(bp2, standing_height=float(np.nextafter(height, 1.0)))
    assert robot_fingerprint(same) == robot_fingerprint(bp2)
    assert robot_fingerprint(replace(bp2, standing_height=height + 1e-9)) != robot_fingerprint(bp2)
