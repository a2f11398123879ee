"""``sprintlab limit``: table, JSON and picture of one search."""

import json

import sprintlab.speed_limit


def test_the_limit_as_json_with_a_picture_and_as_a_table(call, tmp_path, monkeypatch):
    search, found = sprintlab.speed_limit.speed_limit, []

    def search_once(robot, *, progress, **asked):
        found[:] = found or [search(robot, **asked)]
        return found[0]

    monkeypatch.setattr("sprintlab.speed_limit.speed_limit", search_once)
    words, figure = ("limit", "bp2", "--quick", "--starts", 1), tmp_path / "limit.png"
    answer = json.loads(call(*words, "--figure", figure, "--json").out)
    assert 12.0 < answer["speed_limit_m_s"] < 15.0 and answer["stride"]["duty"] < 0.2
    assert answer["limit_without"] == [] and answer["cause"] is None
    assert figure.read_bytes().startswith(b"\x89PNG")
    assert "Speed limit (estimate)" in call(*words).out
