"""``sl.import_robot``: a robot of one's own from Python."""

from pathlib import Path

import pytest

import sprintlab as sl
from sprintlab.core.errors import RobotModelError

GO1 = Path(__file__).parents[2] / "examples" / "go1"


def test_a_model_and_a_file_of_choices_make_a_robot_that_is_found_by_name(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    text = (GO1 / "choices.toml").read_text(encoding="utf-8")
    (tmp_path / "choices.toml").write_text(
        text.replace('name = "go1"\n', "").replace("motor.toml", str(GO1 / "motor.toml")), encoding="utf-8"
    )
    (tmp_path / "mydog.xml").write_bytes((GO1 / "go1.xml").read_bytes())
    made = sl.import_robot("mydog.xml", "choices.toml")
    assert made.folder == Path("robots/mydog") and (made.folder / "train.py").is_file()
    assert sl.load_robot("mydog").total_mass == made.robot.total_mass == pytest.approx(12.74, abs=0.01)
    numbers = made.to_dict()
    assert numbers["robot"] == "mydog" and {check["what"] for check in numbers["checks"]} >= {"mass", "feet"}
    assert "inertia matrix" in str(made) and "written: robots/mydog/" in str(made)
    with pytest.raises(sl.SprintlabError, match="exists"):
        sl.import_robot("mydog.xml", "choices.toml")


def test_a_file_of_choices_that_lacks_something_is_told_all_of_it(tmp_path):
    (tmp_path / "choices.toml").write_text(
        '[joint.abad]\nmotor = "bp2:abad"\ngear_ratio = 6\n[joint.hip]\nmotor = "bp2:hip"\n'
    )
    lacking = r"bus_voltage, joint\.hip\.gear_ratio, joint\.knee\.motor, joint\.knee\.gear_ratio"
    with pytest.raises(RobotModelError, match=rf"choices\.toml lacks {lacking}$"):
        sl.import_robot(GO1 / "go1.xml", tmp_path / "choices.toml", tmp_path)
