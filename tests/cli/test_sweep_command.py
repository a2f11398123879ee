"""``sprintlab sweep`` on the command line: what it plans, refuses and prints."""

from __future__ import annotations

import json

import pytest

from sprintlab.cli import sweep
from sprintlab.core.files import atomic_write_json


def listed(call, *arguments):
    outcome = call("sweep", *arguments, "--dry-run", "--json")
    assert outcome.status == 0
    return json.loads(outcome.out)


def test_all_methods_and_seeds_when_nothing_is_said(call, tmp_path):
    rows = listed(call, tmp_path, "--seeds", 2)
    assert len(rows) == 12
    assert rows[0]["folder"] == str(tmp_path / "baseline" / "seed-0")
    assert not tmp_path.joinpath("baseline").exists()


def test_variations_make_all_combinations(call, tmp_path):
    options = ("--methods", "sprint", "--seeds", 1, "--vary", "ppo.steps=8,16", "--vary", "ppo.epochs=3,5")
    rows = listed(call, tmp_path, *options, "--set", "ppo.discount=0.98")
    assert rows[0]["run"] == "ppo.steps=8,ppo.epochs=3 sprint 0"
    assert len({row["hash"] for row in rows}) == 4


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--methods", "sprinting"), ("sprinting", "baseline")),
        (("--set", "ppo.stepps=3"), ("stepps", "steps")),
        (("--set", "ppo.steps"), ("no assignment",)),
        (("--set", "ppo.steps=0"), ("steps", "0")),
        (("--seeds", "0"), ("seeds",)),
        (("--minutes", "-1"), ("minutes",)),
        (("--save-seconds", "nan"), ("save_seconds",)),
        (("--device", "gpu7"), ("gpu7", "cuda:NUMBER")),
    ],
)
def test_bad_input_is_refused_in_one_sentence(call, tmp_path, arguments, words):
    outcome = call("sweep", tmp_path, *arguments, "--dry-run")
    assert outcome.status == 2
    assert outcome.err.count("\n") == 1
    assert all(word in outcome.err for word in words)


def test_without_its_extra_the_way_to_it_is_named(call, tmp_path, monkeypatch):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    outcome = call("sweep", tmp_path, "--seeds", 1)
    assert outcome.status == 2
    assert "pip install 'sprintlab[sweep]'" in outcome.err


def test_finished_runs_are_listed_as_such_and_cost_nothing(call, tmp_path):
    pytest.importorskip("submitit")
    pytest.importorskip("torch")
    from sprintlab.training.runs.sweep_plan import plan_sweep

    limits = {
        "minutes": sweep.Sweep.minutes,
        "iterations": sweep.Sweep.iterations,
        "environments": sweep.Sweep.environments,
        "save_seconds": 60.0,
    }
    for plan in plan_sweep(tmp_path, ("sprint",), (0,), {}, {}, device="auto", **limits):
        atomic_write_json(plan.folder / "run.json", {**plan.asked(), "finished": True})
        row = {"iteration": 9, "seconds": 60.0, "steps_per_second": 5, "speed_p999": 3.25, "falls": 0.002}
        (plan.folder / "log.jsonl").write_text(json.dumps(row) + "\n")
    options = (tmp_path, "--methods", "sprint", "--seeds", 1)
    assert listed(call, *options)[0]["done"] is True
    table = call("sweep", *options)
    assert table.status == 0
    assert "finished" in table.out and "3.25" in table.out and "2.00" in table.out
    summary = json.loads(call("sweep", *options, "--json").out)
    assert (summary[0]["state"], summary[0]["share"], summary[0]["last"]["iteration"]) == ("finished", 1.0, 9)
