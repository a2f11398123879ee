"""Two engines side by side: the rows, and the mark."""

import json

import pytest
from tests.short_trials import COARSE

from sprintlab.evaluation.protocol import ProtocolSettings
from sprintlab.evaluation.race import evaluate_race
from sprintlab.evaluation.report import render_report
from sprintlab.evaluation.report_text import engine_fault, engine_table
from sprintlab.evaluation.results import EngineResult, SpeedResult, SprintResult
from sprintlab.evaluation.second_engine import mark

SHORT = ProtocolSettings(trials=1, required=1, start=0.5, top=0.5, hold=0.5, plant=COARSE)


@pytest.fixture
def make_run(make_trial):
    def build(engine: str, held: float = 10.0, falls: int = 0) -> EngineResult:
        good = [make_trial(held_speed=held) for _ in range(3 - falls)]
        fallen = [make_trial(completed=False) for _ in range(falls)]
        raw = SpeedResult(top_speed=10.0, self_paced=False, trials=(*good, *fallen), required=3)
        sprint = SprintResult(distance=100.0, time=12.0, trial=raw.trials[0])
        return EngineResult(engine=engine, sprint=sprint, raw=raw)

    return build


@pytest.mark.parametrize(
    ("held", "falls", "words"),
    [
        (10.0, 0, ""),
        (9.1, 0, ""),
        (8.9, 0, "it holds 11 % less speed"),
        (10.0, 1, "1 of 3 trials fell"),
        (8.0, 2, "2 of 3 trials fell and it holds 20 % less speed"),
    ],
)
def test_the_second_engine_marks_what_it_holds_less_or_drops_more_often(make_run, held, falls, words):
    first, second = make_run("mujoco"), make_run("drake", held, falls)
    assert mark(first.raw, second.raw) == words
    assert mark(second.raw, second.raw) == ""


@pytest.mark.usefixtures("brief_trials")
def test_race_in_both_engines(standing_policy, robot):
    """Numbers in result.json, a table and a sentence in the report; standing still earns no mark."""
    pytest.importorskip("pydrake", reason="needs drake: pip install 'sprintlab[drake]'")
    race = evaluate_race(
        standing_policy, robot, top_speed=0.5, distance=0.05, settings=SHORT, second_engine="drake", workers=1
    )
    numbers = race.to_dict()
    assert numbers["engine"] == "mujoco"
    second = numbers["second_engine"]
    assert second["engine"] == "drake" and second["trials"] == 1 and second["falls"] == 0
    assert second["held_speed_m_s"] == pytest.approx(numbers["held_speed_m_s"], abs=0.05)
    assert numbers == json.loads(json.dumps(numbers, allow_nan=False))
    table = engine_table(race)
    assert table is not None and table["names"] == ["MuJoCo", "Drake"]
    assert ("falls", "0 of 1", "0 of 1", "") in table["rows"]
    page = render_report(race, robot, ())
    assert "Two physics engines" in page
    assert engine_fault(race) == ""
