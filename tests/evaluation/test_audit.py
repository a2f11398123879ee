"""The exploit audit: every line fails a made-up offender and passes one that just keeps the limit."""

import math

import pytest

from sprintlab.evaluation.audit import (
    CLOCK_ITEM,
    CLOCK_LOSS_ITEM,
    audit_trials,
    with_clock_loss,
)
from sprintlab.evaluation.report_text import audit_failure


# field of the metrics, offender, one that just passes, what is said of the offender
def one_of(joints, worst):
    """One joint at its worst, the others at half."""
    return (0.5,) * (joints - 1) + (worst,)


# fmt: off
LINES = [
    ("stance_time", 0.0199, 10 * 0.002 - 1e-15, "stance 19.9 ms: at least 20"),
    ("touchdowns_per_stride", 1.21, 1.2, "touchdowns per stride and foot 1.21: at most 1.2"),
    ("foot_force", 4.1, 4.0, "foot force 4.1 body weights: at most 4"),
    ("gear_torque_ratio", one_of(12, 6.8), (3.0,) * 12, "gear torque 6.8 x peak: at most 3"),
    ("joint_speed_ratio", one_of(12, 1.2), (1.1,) * 12, "joint speed 1.2 x no-load: at most 1.1"),
    ("line_winding_temperature", 121.0, 120.0, "hottest winding at the line 121 degC: at most 120"),
    ("pad_deflection", 0.0182, 0.015, "pad deflection 18.2 mm: at most 15"),
    ("smallest_leg_distance", -0.001, 0.0, "smallest leg distance -1 mm: at least 0"),
    ("slip_per_step", 0.06, 0.05, "foot slip per step 60 mm: at most 50"),
    ("lane_excursion", 0.62, 0.61, "farthest foot from the lane's middle 0.62 m: at most 0.61"),
    ("final_speed", 0.31, 0.3, "speed when it should stand 0.31 m/s: at most 0.3"),
    ("stride_frequency", 6.25, 50 / 8.0201, f"{CLOCK_ITEM} 0 policy steps: at least 0.02"),
]
# fmt: on

NEEDS_A_COMMAND = {"least load on a foot", "least duty factor of a foot", "held share of the command"}


def test_a_clean_run_passes_and_every_line_is_tested(make_metrics):
    report = audit_trials([make_metrics()])
    assert report.passed and not report.failed
    said = [words for *_, words in LINES]
    untested = {item.name for item in report.items if not any(text.startswith(item.name) for text in said)}
    assert untested == NEEDS_A_COMMAND
    for item in report.to_dict()["items"]:
        assert item["note"] and item["source"] and item["bound"] in ("at most", "at least")


@pytest.mark.parametrize(("field", "offender", "good", "words"), LINES, ids=[line[0] for line in LINES])
def test_an_offender_fails_its_own_line_and_who_keeps_the_limit_passes(
    make_metrics, field, offender, good, words
):
    report = audit_trials([make_metrics(), *[make_metrics(**{field: offender})] * 3])
    assert [audit_failure(item) for item in report.failed] == [words]
    assert audit_trials([make_metrics(**{field: good})]).passed


@pytest.mark.parametrize(
    ("forces", "passed", "words"),
    [
        ((3.0, 3.9, 4.5), True, ""),
        ((3.0, 3.9, 4.7), False, "foot force 3.9 body weights, worst 4.7: at most 4"),
        ((3.0, 4.1, 4.2), False, "foot force 4.1 body weights, worst 4.2: at most 4"),
    ],
)
def test_the_median_keeps_the_limit_and_no_trial_misses_it_by_more_than_15_percent(
    make_metrics, forces, passed, words
):
    report = audit_trials([make_metrics(foot_force=force) for force in forces])
    assert report.passed == passed
    assert [audit_failure(item) for item in report.failed] == [words] * (not passed)


def test_a_foot_that_never_touches_is_named_from_one_metre_a_second_on(make_metrics):
    lame = {
        "feet": ("FL", "FR", "RL", "RR"),
        "duty_factor": (0.3, 0.6, 0.5, 0.0),
        "load_share": (0.2, 0.4, 0.4, 0.0),
    }
    report = audit_trials([make_metrics(asked_speed=1.0, held_speed=1.0, **lame)])
    assert [audit_failure(item) for item in report.failed] == [
        "least load on a foot 0 (RR never touches the ground): at least 0.1",
        "least duty factor of a foot 0 (RR never touches the ground): at least 0.05",
    ]
    assert audit_trials([make_metrics(asked_speed=0.9, held_speed=0.9, **lame)]).passed


@pytest.mark.parametrize(("held", "passed"), [(0.0, False), (3.1, False), (3.3, True)])
def test_a_robot_must_hold_most_of_its_command(make_metrics, held, passed):
    report = audit_trials([make_metrics(asked_speed=4.0, held_speed=held, load_share=(0.25,) * 4)])
    assert report.passed == passed


@pytest.mark.parametrize(("loss", "passed"), [(0.019, True), (0.021, False), (1.0, False)])
def test_a_gait_that_the_clock_times_passes_if_other_clocks_cost_little(make_metrics, loss, passed):
    locked = audit_trials([make_metrics(stride_frequency=6.25)])
    judged = with_clock_loss(locked, loss)
    assert not locked.passed and judged.passed == passed
    assert judged.items[-1].name == CLOCK_LOSS_ITEM and CLOCK_ITEM not in {item.name for item in judged.items}


def test_what_never_happened_is_not_held_against_a_run(make_metrics):
    fields = ("stance_time", "slip_per_step", "stride_frequency", "foot_force", "final_speed")
    report = audit_trials([make_metrics(**dict.fromkeys(fields, math.nan))])
    assert report.passed
    assert report.to_dict()["items"][0]["value"] is None
