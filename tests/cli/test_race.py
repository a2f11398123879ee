"""The main job from the command line, with a policy that stands still."""

import hashlib
import json
import os
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sprintlab.api.evaluations import evaluate
from sprintlab.api.search import SearchOptions
from sprintlab.control import load_policy
from sprintlab.core.errors import SprintlabError, UnwrittenError
from sprintlab.evaluation import race
from sprintlab.evaluation.race_files import race_facts
from sprintlab.robots import load_robot, robot_fingerprint
from sprintlab.robots.loader import robot_table_path

PROMISED = {
    "time_100m_s",
    "peak_speed_m_s",
    "held_speed_m_s",
    "J_rad2_s",
    "falls",
    "trials",
    "envelope_share",
    "cost_of_transport",
    "audit",
}
FIGURES = {"sprint", "speed", "torque_speed", "gait", "base_rates", "power"}


@pytest.mark.usefixtures("brief_trials", "light_pictures")
def test_race_leaves_a_complete_folder(call, policy, tmp_path):
    folder = tmp_path / "run"
    # Half a metre instead of a hundred: a robot that stands has failed the sooner, the shorter the way.
    outcome = call(
        "race", policy, "--output", folder, "--top-speed", 2, "--trials", 1, "--workers", 1, "--no-video",
        "--distance", 0.5,
    )  # fmt: skip
    assert outcome.status == 0
    assert "not finished" in outcome.out and str(folder / "report.html") in outcome.out
    assert "\x1b" not in outcome.out
    expected = {f"{name}.png" for name in FIGURES}
    expected |= {"report.html", "replay.html", "result.json", "trajectory.npz", "profile.npz"}
    assert {path.name for path in folder.iterdir()} == expected
    assert [path.name for path in tmp_path.iterdir()] == ["run"]

    numbers = json.loads((folder / "result.json").read_text())
    assert set(numbers) >= PROMISED
    assert numbers["time_100m_s"] is None and numbers["falls"] == 0
    assert len(numbers["facts"]["policy SHA-256"]) == 64
    with np.load(folder / "trajectory.npz") as archive:
        assert archive["motor_torque"].shape == (len(archive["time"]), 12)


@pytest.mark.usefixtures("brief_trials", "blank_pictures")
def test_a_race_tells_of_the_policy_that_ran_whatever_lies_there_after_it(
    call, policy, tmp_path, monkeypatch
):
    mine, run = tmp_path / "mine.onnx", race.evaluate_race
    mine.write_bytes(content := Path(policy).read_bytes())

    def and_then_replaced(*given, **options):
        found = run(*given, **options)
        mine.unlink()
        os.mkfifo(mine)
        return found

    monkeypatch.setattr(race, "evaluate_race", and_then_replaced)
    brief = ("--top-speed", 2, "--trials", 1, "--workers", 1, "--no-video", "--distance", 0.5)
    assert call("race", mine, "--output", tmp_path / "run", *brief).status == 0
    facts = json.loads((tmp_path / "run" / "result.json").read_text())["facts"]
    assert facts["policy SHA-256"] == hashlib.sha256(content).hexdigest()
    assert facts["training seed"] == str(load_policy(policy).contract.training.seed)


@pytest.mark.usefixtures("blank_pictures")
@pytest.mark.parametrize("change", ["edited", "gone"])
def test_a_report_is_of_no_other_robot_than_the_one_that_ran(
    call, policy, tmp_path, monkeypatch, computed, change
):
    table, folder = tmp_path / "mine.toml", tmp_path / "run"
    table.write_text(written := robot_table_path("bp2").read_text())

    def and_then_changed(*_, **__):
        table.unlink()
        if change == "edited":
            table.write_text(written.replace("bus_voltage = { value = 60.0", "bus_voltage = { value = 50.0"))
        return computed

    monkeypatch.setattr(race, "evaluate_race", and_then_changed)
    outcome = call("race", policy, "--robot", table, "--output", folder, "--top-speed", 2, "--no-video")
    reason = "has changed since the race began" if change == "edited" else "No such file"
    assert outcome.status == 2 and reason in outcome.err and not folder.exists()
    assert "Exploit audit" in outcome.out, "the numbers are those of the robot that ran"


def test_what_a_file_says_of_itself_turns_no_writing_of_the_report(computed):
    told = replace(computed, policy_facts={"method": "\x1b[2J\u202esprint"})
    facts = race_facts(Path("a\u202eb.onnx"), told, "sprintlab race a\u202eb.onnx")
    assert facts["method"] == r"\x1b[2J\u202esprint"
    assert all(fact.isprintable() for fact in facts.values())


@pytest.mark.usefixtures("computed")
@pytest.mark.parametrize("change", ["edited", "gone"])
def test_a_report_is_of_one_robot_whatever_becomes_of_its_table_while_it_is_drawn(
    call, policy, tmp_path, monkeypatch, change
):
    table, folder = tmp_path / "mine.toml", tmp_path / "run"
    table.write_text(written := robot_table_path("bp2").read_text())
    drawn = []

    def change_table(_draw):
        table.unlink(missing_ok=True)
        if change == "edited":
            table.write_text(written.replace("length = { value = 0.31", "length = { value = 0.36"))
        return b"light", b"dark"

    def render(_recording, film, *_):
        film.write_bytes(b"of whatever robot the table says")
        return ""

    monkeypatch.setattr("sprintlab.evaluation.report.png_in_both_looks", change_table)
    monkeypatch.setattr("sprintlab.evaluation.race_files.render_video", render)
    replay = "sprintlab.viewer.replay.write_replay"
    monkeypatch.setattr(replay, lambda page, arrays, robot, text: drawn.append(robot))
    outcome = call("race", policy, "--robot", table, "--output", folder, "--top-speed", 2)
    assert outcome.status == 0 and "Exploit audit" in outcome.out
    assert [robot_fingerprint(robot) for robot in drawn] == [robot_fingerprint(load_robot("bp2"))]
    assert (folder / "report.html").is_file()


@pytest.mark.usefixtures("computed", "blank_pictures")
def test_race_prints_json_only(call, policy, tmp_path):
    arguments = ("--top-speed", 12, "--trials", 1, "--workers", 1, "--no-video", "--json")
    numbers = json.loads(call("race", policy, "--output", tmp_path / "run", *arguments).out)
    assert set(numbers) >= PROMISED and numbers["folder"] == str(tmp_path / "run")


@pytest.mark.parametrize(("policy_name", "robot_name"), [("sprint", "bp2"), ("go1-sprint", "go1")])
def test_the_robot_follows_from_the_policy(call, monkeypatch, policy_name, robot_name):
    def evaluate_only_in_name(_policy, robot, **_settings):
        raise SprintlabError(f"this would run {robot.name}")

    monkeypatch.setattr("sprintlab.evaluation.race.evaluate_race", evaluate_only_in_name)
    outcome = call("race", policy_name, "--top-speed", 2)
    assert outcome.status == 2 and f"this would run {robot_name}" in outcome.err


@pytest.mark.usefixtures("brief_trials")
def test_evaluate_searches_the_highest_speed(call, policy, tmp_path, run_once):
    run_once("sprintlab.evaluation.pool.run_request")
    options = ("--start", 0.5, "--top", 0.75, "--trials", 1, "--workers", 1, "--common-speed", 0.5)
    outcome = call("evaluate", policy, *options, "--output", tmp_path / "numbers.json")
    numbers = json.loads((tmp_path / "numbers.json").read_text())
    assert set(numbers) == {"raw", "self_paced", "battery"}
    assert [row["top_speed_m_s"] for row in numbers["raw"]["speeds"]] == [0.5, 0.75]
    assert numbers["raw"]["top_speed_command_m_s"] == 0.75
    assert numbers["raw"]["J_common_rad2_s"] >= 0.0
    assert numbers["raw"]["fastest"] in numbers["raw"]["speeds"]
    assert numbers["raw"]["audit_failed"] == [] and numbers["raw"]["fastest_with_audit_passed"] is not None
    assert re.search(r"max velocity: .*\s-?0\.\d\d\s+-?0\.\d\d\s+m/s", outcome.out)
    assert re.search(r"J at the common speed\s+0\.\d\d", outcome.out)
    again = call("evaluate", policy, *options, "--output", tmp_path / "again.json", "--json")
    assert json.loads(again.out) == json.loads((tmp_path / "again.json").read_text()) == numbers


@pytest.mark.usefixtures("brief_trials", "full_disk")
def test_an_evaluation_is_not_lost_with_its_file(call, policy, tmp_path, run_once):
    run_once("sprintlab.evaluation.pool.run_request")
    options = ("--start", 0.5, "--top", 0.5, "--trials", 1, "--workers", 1)
    outcome = call("evaluate", policy, *options, "--output", tmp_path / "numbers.json", "--json")
    assert outcome.status == 2 and "numbers.json: No space left on device" in outcome.err
    assert [row["top_speed_m_s"] for row in json.loads(outcome.out)["raw"]["speeds"]] == [0.5]
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(UnwrittenError) as refused:
        evaluate(
            policy, search=SearchOptions(start=0.5, top=0.5, trials=1), workers=1, output=tmp_path / "file"
        )
    assert refused.value.found.to_dict() == json.loads(outcome.out), "who calls gets them, too"
