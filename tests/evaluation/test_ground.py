"""What slopes and rough ground cost: which trials run, and what is made of them."""

import math

import pytest

from sprintlab.core.errors import InvalidValueError
from sprintlab.evaluation.ground import GroundResult, GroundSettings, GroundTrials, compare_grounds
from sprintlab.evaluation.pool import TrialPool
from sprintlab.evaluation.protocol import ProtocolSettings

KINDS = ("level", "uphill", "downhill", "rough")


def result_with(*speeds, falls=()):
    grounds = [
        GroundTrials(name=name, trials=3, held_speed=speed, falls=falls)
        for name, speed in zip(KINDS, speeds, strict=True)
    ]
    return GroundResult(settings=GroundSettings(top_speed=10.0), grounds=tuple(grounds))


def test_every_ground_gets_the_protocols_trials_and_rough_ground_heights_of_its_own():
    settings = GroundSettings(top_speed=8.0, trials=2, slope=0.1, roughness=0.03)
    requests = settings.requests()
    assert tuple(settings.grounds()) == KINDS and len(requests) == 8
    drawn = ProtocolSettings(trials=2, required=1).trial_settings()
    assert [request.settings for request in requests] == [*drawn] * 4
    grounds = [request.plant.ground for request in requests]
    assert [ground.slope for ground in grounds] == [0.0, 0.0, 0.1, 0.1, -0.1, -0.1, 0.0, 0.0]
    assert [ground.roughness for ground in grounds] == [0.0] * 6 + [0.03] * 2
    assert grounds[-1].seed != grounds[-2].seed


def test_a_ground_is_met_when_all_stay_upright_and_little_speed_is_lost():
    found = result_with(10.0, 8.6, 10.5, 8.4)
    assert [found.met(ground) for ground in found.grounds] == [True, True, True, False]
    assert found.change(found.grounds[1]) == pytest.approx(-0.14)
    fell = result_with(10.0, 10.0, 10.0, 10.0, falls=("tilt",))
    assert not any(fell.met(ground) for ground in fell.grounds)


def test_what_is_not_defined_is_null_and_not_met():
    found = result_with(10.0, math.nan, 10.0, 10.0, falls=("tilt",) * 3)
    row = found.to_dict()["grounds"][1]
    assert (
        row["held_speed_m_s"] is None
        and row["change"] is None
        and row["upright"] == 0
        and row["met"] is False
    )
    standing = result_with(0.01, 0.02, 0.0, 0.0)
    assert math.isnan(standing.change(standing.grounds[1])) and not standing.met(standing.grounds[1])


@pytest.mark.usefixtures("brief_trials")
def test_a_policy_that_stands_stays_upright_everywhere(standing_policy, robot):
    told = []
    with TrialPool(standing_policy, robot, workers=1) as pool:
        settings = GroundSettings(top_speed=0.5, trials=1, hold=0.5)
        found = compare_grounds(pool, settings, lambda kind, share: told.append((kind, share)))
    assert told == list(zip(KINDS, (0.25, 0.5, 0.75, 1.0), strict=True))
    assert [ground.upright for ground in found.grounds] == [1, 1, 1, 1]
    assert all(abs(ground.held_speed) < 0.05 for ground in found.grounds)


@pytest.mark.parametrize(
    ("values", "field"),
    [
        ({"top_speed": 17.0}, "ground.top_speed"),
        ({"trials": 0}, "ground.trials"),
        ({"slope": 0.0}, "ground.slope"),
        ({"slope": 0.4}, "ground.slope"),
        ({"roughness": 0.0}, "ground.roughness"),
        ({"roughness": 0.5}, "ground.roughness"),
    ],
)
def test_bad_settings_are_refused(values, field):
    with pytest.raises(InvalidValueError, match=field.replace(".", r"\.")):
        GroundSettings(**{"top_speed": 10.0, **values})
