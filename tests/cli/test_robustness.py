"""Robustness from the command line, with a policy that stands still."""

import json

import pytest

SHORT = ("--top-speed", 2, "--trials", 2, "--cause-trials", 1, "--distance", 0.2, "--workers", 1)


@pytest.mark.usefixtures("brief_trials")
def test_it_prints_draws_and_goes_on(call, policy, tmp_path):
    where = ("--output", tmp_path / "sprints", "--figure", tmp_path / "picture.png")
    outcome = call("robustness", policy, *SHORT, *where)
    assert outcome.status == 0
    assert "upright" in outcome.out and "One cause at a time" in outcome.out and "friction" in outcome.out
    assert (tmp_path / "picture.png").stat().st_size > 10_000
    files = {path.name: path.stat().st_mtime_ns for path in (tmp_path / "sprints").iterdir()}
    assert len(files) == 2 + 11 + 1

    again = call(
        "robustness", policy, "--trials", 2, "--cause-trials", 1, "--distance", 0.2, *where[:2], "--json"
    )
    numbers = json.loads(again.out)
    assert numbers["trials"] == 2 and numbers["top_speed_command_m_s"] == 2.0
    assert 0.0 <= numbers["share_upright"] <= 1.0 and len(numbers["causes"]) == 10
    assert files == {path.name: path.stat().st_mtime_ns for path in (tmp_path / "sprints").iterdir()}


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (("--figure", "picture.jpg"), ".png"),
        (("--trials", 0), "trials"),
        (("--top-speed", -1), "top_speed"),
        (("--distance", 0), "distance"),
    ],
)
def test_bad_settings_are_refused_in_one_sentence(call, policy, tmp_path, arguments, named):
    outcome = call(
        "robustness", policy, "--top-speed", 2, "--workers", 1, "--output", tmp_path / "s", *arguments
    )
    assert outcome.status == 2 and named in outcome.err and outcome.err.count("\n") == 1
    assert not (tmp_path / "s").exists()
