"""``sprintlab motor library``: the comparison, one actuator, its file."""

import json

import pytest

from sprintlab.motors import library_motors, load_library_motor, load_motor


def test_the_table_names_every_actuator(call):
    outcome = call("motor", "library")
    assert outcome.status == 0
    assert all(name in outcome.out for name in library_motors())


def test_json_carries_every_number_with_its_source(call):
    entries = json.loads(call("motor", "library", "--json").out)
    assert [entry["name"] for entry in entries] == list(library_motors())
    for entry in entries:
        assert all(value["source"] for value in entry["values"].values())
        assert 0 < entry["joint"]["corner_speed"] < entry["joint"]["no_load_speed"]
    u12 = next(entry for entry in entries if entry["name"] == "mit-humanoid-u12")
    assert u12["joint"]["corner_speed"] == pytest.approx(24.5, abs=0.05)
    assert u12["joint"]["corner_lost_to_v_d"] == pytest.approx(0.186, abs=0.001)


def test_one_actuator_prints_its_sources(call):
    out = call("motor", "library", "xiaomi-cybergear").out
    assert "CyberGear micro motor user manual" in " ".join(out.split())
    assert "estimated" in out


def test_the_saved_motor_is_the_actuator_s(call, tmp_path):
    path = tmp_path / "u12.toml"
    outcome = call("motor", "library", "mit-humanoid-u12", "--save", path)
    assert outcome.status == 0
    assert load_motor(path) == load_library_motor("mit-humanoid-u12").motor


def test_the_figure_is_a_picture(call, tmp_path):
    path = tmp_path / "library.png"
    assert call("motor", "library", "--figure", path).status == 0
    assert path.read_bytes()[:4] == b"\x89PNG"
    assert path.stat().st_size > 30_000


@pytest.mark.parametrize(
    ("arguments", "message"),
    [(("u13",), "choose one of cubemars-ake80-8"), (("--save", "x.toml"), "name the actuator")],
)
def test_refuses_with_one_sentence(call, arguments, message):
    outcome = call("motor", "library", *arguments)
    assert outcome.status == 2
    assert message in outcome.err
    assert outcome.err.count("\n") == 1
