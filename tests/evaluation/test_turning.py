"""The turning map: what is asked for, what is measured, and a robot that stands or falls."""

import math

import numpy as np
import pytest
from tests.short_trials import COARSE

from sprintlab.core.errors import InvalidValueError
from sprintlab.evaluation import turning
from sprintlab.evaluation.pool import TrialPool
from sprintlab.evaluation.turning import (
    TurningCommand,
    TurningMap,
    TurningPoint,
    TurningSettings,
    turning_map,
    turning_rows,
)
from sprintlab.plant import BaseState


def point(speed, rate, gain=1.0, fell=""):
    achieved = math.nan if fell else gain * rate
    return TurningPoint(
        command=TurningCommand(speed=speed, yaw_rate=rate), yaw_rate=achieved, speed=speed, fall_reason=fell
    )


def test_commands_reach_the_friction_hyperbola_and_no_further():
    settings = TurningSettings(speeds=(0.0, 4.0, 12.0), fractions=(-1.0, 0.5, 1.0))
    assert len(settings.cells) == 9
    for cell in settings.cells:
        assert abs(cell.yaw_rate) <= 1.0 and abs(cell.speed * cell.yaw_rate) <= 0.85 * 9.81 + 1e-3
    assert settings.cells[-1].yaw_rate == pytest.approx(0.85 * 9.81 / 12.0, rel=1e-3)


def test_a_turn_begins_when_the_speed_is_asked_for():
    turn = turning._Turn(TurningCommand(speed=-4.0, yaw_rate=0.5), 3.0)
    base = BaseState(forward_speed=0.0, heading=0.0, lateral_offset=0.0, distance=0.0)
    assert turn.speed(0.5, base) == 0.0 and turn.steer(base, 0.0) == 0.0
    assert turn.speed(1.5, base) == -2.0 and turn.steer(base, -2.0) == 0.0
    assert turn.speed(2.0, base) == -4.0 and turn.steer(base, -4.0) == 0.5
    assert turn.speed(5.0, base) is None


def test_the_achieved_rate_is_that_of_the_last_two_seconds(make_trajectory):
    time = np.arange(2500) / 500.0
    heading = np.where(time < 2.5, 0.0, 0.3 * (time - 2.5))
    velocity = np.stack((np.full(2500, 4.0), np.zeros(2500)), axis=-1)
    rate, speed = turning._achieved(make_trajectory(5.0, heading=heading, velocity=velocity))
    assert rate == pytest.approx(0.3) and speed == pytest.approx(4.0)


def test_only_moderate_turns_make_the_least_gain_and_a_fall_makes_it_undefined():
    settings = TurningSettings(speeds=(8.0,), fractions=(0.5, 1.0))
    half, whole = (cell.yaw_rate for cell in settings.cells)
    found = TurningMap(settings=settings, points=(point(8.0, half, 0.9), point(8.0, whole, 0.1)))
    assert found.least_gain == pytest.approx(0.9) and found.falls == 0
    assert turning_rows(found)[0][2:] == ("90 %", "10 %")
    fell = TurningMap(settings=settings, points=(point(8.0, half, fell="tilt"), point(8.0, whole)))
    assert math.isnan(fell.least_gain) and fell.falls == 1
    assert fell.to_dict()["least_gain_up_to_half_of_friction"] is None
    assert turning_rows(fell)[0][2] == "fell"


def test_a_policy_that_stands_does_not_turn(standing_policy, robot):
    settings = TurningSettings(speeds=(0.0,), fractions=(-0.5, 0.5), turn=2.0, plant=COARSE)
    shares = []
    with TrialPool(standing_policy, robot, workers=1) as pool:
        found = turning_map(pool, settings, lambda _, share: shares.append(share))
    assert shares == [0.5, 1.0] and found.falls == 0
    assert abs(found.least_gain) < 0.02


@pytest.mark.parametrize(
    ("values", "field"),
    [
        ({"speeds": ()}, "turning.speeds"),
        ({"fractions": (0.0,)}, "turning.fractions"),
        ({"fractions": (1.5,)}, "turning.fractions"),
        ({"speeds": (99.0,)}, "turning.speeds"),
        ({"turn": 1.0}, "turning.turn"),
    ],
)
def test_bad_settings_are_refused(values, field):
    with pytest.raises(InvalidValueError, match=field.replace(".", r"\.")):
        TurningSettings(**values)


def test_the_picture_marks_falls_and_labels_its_axes():
    from sprintlab.evaluation.turning_figure import turning_figure

    settings = TurningSettings(speeds=(8.0,), fractions=(0.5, 1.0))
    half, whole = (cell.yaw_rate for cell in settings.cells)
    figure = turning_figure(
        TurningMap(settings=settings, points=(point(8.0, half, 0.9), point(8.0, whole, fell="tilt")))
    )
    (axis,) = figure.axes
    assert "m/s" in axis.get_xlabel() and "rad/s" in axis.get_ylabel()
    assert "fell" in [text.get_text() for text in figure.legends[0].get_texts()]
