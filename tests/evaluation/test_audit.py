"""The exploit audit."""

import math

import pytest

from sprintlab.core.errors import InvalidValueError
from sprintlab.evaluation.audit import AuditThresholds, audit_trials, clock_distance


def test_a_clean_run_passes(make_metrics):
    report = audit_trials([make_metrics()])
    assert report.passed and len(report.items) == 5


@pytest.mark.parametrize(
    ("index", "field", "value"),
    [
        (0, "deepest_penetration", 0.0051),
        (1, "smallest_leg_distance", -0.001),
        (2, "slip_per_step", 0.06),
        (3, "joint_speed_ratio", (0.5,) * 11 + (1.2,)),
        (4, "stride_frequency", 6.25),
    ],
)
def test_each_exploit_fails_its_own_item(make_metrics, index, field, value):
    report = audit_trials([make_metrics(), make_metrics(**{field: value}), make_metrics(**{field: value})])
    assert [item.passed for item in report.items] == [position != index for position in range(5)]
    assert not report.passed


def test_the_worst_trial_counts_but_one_locked_stride_among_many_does_not(make_metrics):
    worst = audit_trials([make_metrics(), make_metrics(deepest_penetration=0.02), make_metrics()])
    assert worst.items[0].value == 0.02
    assert audit_trials([make_metrics(), make_metrics(stride_frequency=6.25), make_metrics()]).passed


def test_what_never_happened_is_not_held_against_a_run(make_metrics):
    report = audit_trials([make_metrics(slip_per_step=math.nan, stride_frequency=math.nan)])
    assert report.passed
    assert report.to_dict()["items"][2]["value"] is None


@pytest.mark.parametrize(
    ("frequency", "distance"),
    [(6.25, 0.0), (5.0, 0.0), (50 / 8.5, 0.5), (50 / 8.1, 0.1)],
)
def test_clock_distance_in_policy_steps(frequency, distance):
    assert clock_distance(frequency) == pytest.approx(distance, abs=1e-9)


def test_thresholds_must_be_positive():
    with pytest.raises(InvalidValueError, match="penetration"):
        AuditThresholds(penetration=0.0)
