"""``sprintlab train`` and ``sweep``: settings that arrive, plans, and what is said at the end."""

from __future__ import annotations

import json

import pytest


def dry(call, *words):
    outcome = call("train", *words, "--dry-run", "--json")
    assert outcome.status == 0, outcome.err
    return json.loads(outcome.out)


def test_what_is_typed_wins_over_the_file_and_that_over_the_method(call, tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text("[ppo]\nsteps = 16\nepochs = 3\n", encoding="utf-8")
    words = ("go1", "--method", "no-envelope", "--seed", 3, "--settings", path, "--set", "ppo.steps=8")
    found = dry(call, *words)
    assert (found["robot"], found["method"], found["seed"]) == ("go1", "no-envelope", 3)
    assert (found["actuator_model"], found["ppo"]["steps"], found["ppo"]["epochs"]) == ("square", 8, 3)


def test_the_settings_of_a_dry_run_train_the_same(call, tmp_path):
    text = call("train", "bp2", "--set", "ppo.steps=8", "--dry-run").out
    (tmp_path / "run.toml").write_text(text, encoding="utf-8")
    again = call("train", "bp2", "--settings", tmp_path / "run.toml", "--dry-run").out
    assert again == text and "steps = 8" in text


def listed(call, *arguments):
    outcome = call("sweep", *arguments, "--dry-run", "--json")
    assert outcome.status == 0
    return json.loads(outcome.out)


def test_finished_runs_are_listed_as_such_and_cost_nothing(call, tmp_path):
    pytest.importorskip("torch")
    folder = tmp_path / "acs" / "seed-0"
    folder.mkdir(parents=True)
    (folder / "policy.onnx").write_text("trained")
    row = {"iteration": 9, "seconds": 60.0, "speed_p95": 3.25, "falls": 0.002}
    (folder / "log.jsonl").write_text(json.dumps(row) + "\n")
    options = (tmp_path, "--methods", "acs", "--seeds", 1)
    assert listed(call, *options)[0]["done"] is True
    table = call("sweep", *options)
    assert table.status == 0 and "finished" in table.out and "3.25" in table.out
    (summary,) = json.loads(call("sweep", *options, "--json").out)
    assert (summary["state"], summary["last"]["iteration"]) == ("finished", 9)
