"""``sprintlab limit``: table, JSON, picture, and bad input."""

import json
from dataclasses import replace

import pytest

import sprintlab.speed_limit

QUICK = ("--quick", "--starts", 1)


@pytest.fixture(scope="module")
def known():
    """Limits that were searched for: a robot's is the same in every test."""
    return {}


@pytest.fixture
def searched_once(monkeypatch, known):
    search = sprintlab.speed_limit.speed_limit

    def search_or_repeat(robot, *, trained, progress, **asked):
        key = (robot.name, repr(asked))
        if key not in known:
            known[key] = search(robot, **asked)
        return replace(known[key], trained=tuple(trained))

    monkeypatch.setattr("sprintlab.speed_limit.speed_limit", search_or_repeat)


def test_the_limit_as_json_with_a_picture(call, tmp_path):
    result = {"robot": "bp2", "policy": "sprint", "held_speed_m_s": 10.45, "falls": 0}
    (tmp_path / "result.json").write_text(json.dumps(result), encoding="utf-8")
    figure = tmp_path / "limit.png"
    outcome = call("limit", "bp2", *QUICK, "--results", tmp_path, "--figure", figure, "--json")
    assert outcome.status == 0
    answer = json.loads(outcome.out)
    assert 12.0 < answer["speed_limit_m_s"] < 15.0
    assert answer["stride"]["duty"] < 0.2
    assert answer["trained"][0]["speed"] == 10.45
    assert answer["limit_without"] == [] and answer["cause"] is None
    assert figure.read_bytes().startswith(b"\x89PNG")


@pytest.mark.usefixtures("searched_once")
def test_the_limit_as_a_table(call, tmp_path):
    outcome = call("limit", "go1", *QUICK, "--results", tmp_path)
    assert outcome.status == 0
    assert "Speed limit (upper estimate)" in outcome.out
    assert "stride: frequency" in outcome.out
