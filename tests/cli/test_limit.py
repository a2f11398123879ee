"""``sprintlab limit``: table, JSON and picture of one search."""

import json
from dataclasses import replace

import sprintlab.speed_limit


def test_the_limit_as_json_with_a_picture_and_as_a_table(call, tmp_path, monkeypatch):
    result = {"robot": "bp2", "policy": "sprint", "held_speed_m_s": 10.45, "falls": 0}
    (tmp_path / "result.json").write_text(json.dumps(result), encoding="utf-8")
    search, found = sprintlab.speed_limit.speed_limit, []

    def search_once(robot, *, trained, progress, **asked):
        found[:] = found or [search(robot, **asked)]
        return replace(found[0], trained=tuple(trained))

    monkeypatch.setattr("sprintlab.speed_limit.speed_limit", search_once)
    words, figure = ("limit", "bp2", "--quick", "--starts", 1, "--results", tmp_path), tmp_path / "limit.png"
    answer = json.loads(call(*words, "--figure", figure, "--json").out)
    assert 12.0 < answer["speed_limit_m_s"] < 15.0 and answer["stride"]["duty"] < 0.2
    assert answer["trained"][0]["speed"] == 10.45
    assert answer["limit_without"] == [] and answer["cause"] is None
    assert figure.read_bytes().startswith(b"\x89PNG")
    assert "Speed limit (upper estimate)" in call(*words).out
