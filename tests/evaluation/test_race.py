"""The race, and the numbers that go into its JSON."""

import json
from dataclasses import replace

import pytest
from tests.short_trials import BRIEF, COARSE, shorten_trials

from sprintlab.evaluation import race as race_module
from sprintlab.evaluation.clock import CLOCKS
from sprintlab.evaluation.disturbances import PolicyClock
from sprintlab.evaluation.protocol import ProtocolSettings
from sprintlab.evaluation.race import audit_race, evaluate_race
from sprintlab.evaluation.results import SpeedResult

KEYS = {
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
SHORT = ProtocolSettings(trials=2, required=1, start=0.5, top=0.5, hold=0.5)


@pytest.fixture(scope="module")
def race(standing_policy, robot):
    with pytest.MonkeyPatch.context() as patch:
        shorten_trials(patch.setitem, BRIEF)  # in a user's steps of physics
        return evaluate_race(standing_policy, robot, top_speed=0.5, distance=0.05, settings=SHORT, workers=1)


def test_the_json_has_the_promised_keys(race):
    numbers = race.to_dict()
    assert set(numbers) >= KEYS
    assert numbers == json.loads(json.dumps(numbers, allow_nan=False))
    assert numbers["trials"] == 2 and numbers["falls"] == 0
    assert len(numbers["envelope_share"]) == 12
    assert numbers["time_100m_s"] is None  # it stood


@pytest.mark.usefixtures("brief_trials")
def test_without_a_top_speed_it_is_searched_and_said(standing_policy, robot, monkeypatch):
    monkeypatch.setattr(race_module, "require_a_runner", lambda *_: None)
    coarse = replace(SHORT, plant=COARSE)
    result = evaluate_race(standing_policy, robot, distance=0.05, settings=coarse, workers=1)
    assert result.top_speed == 0.5
    assert "0.5 m/s" in result.notes[0]


@pytest.mark.parametrize(("held", "passed"), [(11.9, True), (11.5, False)])
def test_other_clocks_judge_a_race_whose_only_fault_is_a_stride_that_the_clock_times(
    make_trial, held, passed
):
    def trials(speed, stride):
        return [make_trial(held_speed=speed, stride_frequency=stride) for _ in range(2)]

    class Pool:
        def trials(self, requests):
            asked.extend(request.clock for request in requests)
            return trials(held, 5.6)

    asked: list[PolicyClock] = []
    locked, free = trials(12.0, 6.25), trials(12.0, 5.6)
    for runs, clocks in ((locked, CLOCKS[1:]), (free, ())):
        asked.clear()
        speed = SpeedResult(top_speed=12.0, self_paced=False, trials=tuple(runs), required=1)
        audit = audit_race(Pool(), (), speed, replace(speed, self_paced=True), SHORT)
        assert asked == [clock for clock in clocks for _ in range(2)]
        assert audit.passed == (passed if clocks else True)
