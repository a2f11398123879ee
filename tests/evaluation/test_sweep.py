"""Robustness, ground and turning: what is run, how it is kept, and what it amounts to."""

import json
from dataclasses import replace

import numpy as np
import pytest

from sprintlab.core.theme import png_bytes
from sprintlab.evaluation.ground import ground_cases, ground_numbers
from sprintlab.evaluation.pool import TrialPool
from sprintlab.evaluation.protocol import ProtocolSettings
from sprintlab.evaluation.robustness import (
    ALL,
    CAUSES,
    NOMINAL,
    StudySettings,
    draw_request,
    run_study,
    summarize,
    wilson_interval,
)
from sprintlab.evaluation.sweep import Run, achieved, run_cases
from sprintlab.evaluation.sweep_figures import robustness_figure, turning_figure
from sprintlab.evaluation.turning import FRACTIONS, Turn, turning_numbers, turning_rows, turns
from sprintlab.plant import BaseState, PlantOptions

DRAWN = {"top_speed": 2.0, "bus_voltage": 60.0}
SHORT = StudySettings(top_speed=2.0, trials=3, cause_trials=0, distance=0.2)


@pytest.fixture
def pool(standing_policy, robot):
    with TrialPool(standing_policy, robot, workers=1) as opened:
        yield opened


def run(group, seed, speed=None, fell="", **values):
    return Run(
        group=group,
        seed=seed,
        fall_reason=fell,
        fall_time_s=3.0 if fell else None,
        held_speed_m_s=None if fell else speed,
        distance_m=100.0,
        time_s=None if fell else 10.0,
        **values,
    )


# --- robustness --------------------------------------------------------------------------------------------


def drawn(seed, group):
    """What a sprint differs in, by cause."""
    request = draw_request(seed, group, **DRAWN)
    settings, plant = request.settings, request.plant
    values = (
        settings.friction, settings.payload, settings.center_of_mass, settings.strength, plant.bus_voltage,
        settings.delay, settings.sensor_noise, settings.joint_offset, settings.push_speed, plant.foot,
    )  # fmt: skip
    return dict(zip(CAUSES, values, strict=True))


BANDS = {
    "friction": (0.5, 1.2),
    "payload": (-1.0, 4.0),
    "centre of mass": (-0.03, 0.03),
    "strength": (0.9, 1.0),
    "bus voltage": (54.0, 60.0),
    "delay": (0.0, 0.010),
}


def test_everything_varies_over_its_whole_band():
    draws = [drawn(seed, ALL) for seed in range(300)]
    for cause, (low, high) in BANDS.items():
        values = np.array([draw[cause] for draw in draws])
        assert values.min() >= low and values.max() <= high
        assert values.min() < low + 0.05 * (high - low) and values.max() > high - 0.05 * (high - low)
    stiffness = np.array([draw["foot"].stiffness for draw in draws])
    assert 40e3 <= stiffness.min() < 43e3 and 150e3 < stiffness.max() <= 160e3
    assert np.median(stiffness) == pytest.approx(80e3, rel=0.15)


@pytest.mark.parametrize("cause", CAUSES)
def test_a_cause_alone_is_drawn_as_together_with_the_others_and_nothing_else_is(cause):
    alone, together, nominal = (drawn(7, group) for group in (cause, ALL, NOMINAL))
    assert alone[cause] == together[cause] != nominal[cause]
    assert {**alone, cause: None} == {**nominal, cause: None}


@pytest.mark.usefixtures("short_trials")
def test_killed_and_resumed_equals_uninterrupted(pool, tmp_path):
    def interrupt(done, total):
        raise KeyboardInterrupt

    whole = run_study(pool, SHORT, tmp_path / "whole")
    with pytest.raises(KeyboardInterrupt):
        run_study(pool, SHORT, tmp_path / "cut", interrupt)
    assert {path.name for path in (tmp_path / "cut").iterdir()} == {"study.json", "all-000000.json"}
    told = []
    assert run_study(pool, SHORT, tmp_path / "cut", lambda *now: told.append(now)) == whole
    assert told == [(2, 3), (3, 3)]
    more = run_study(pool, replace(SHORT, trials=4), tmp_path / "cut")
    assert more[:3] == whole and len(more) == 4


def test_shares_quantiles_and_costs_of_made_up_sprints():
    runs = [run(ALL, seed, 9.0 + 0.1 * seed, "tilt" * (seed >= 11), left_lane=not seed) for seed in range(20)]
    runs += [run(NOMINAL, seed, 10.0 + seed) for seed in range(3)]
    runs += [run("delay", seed, 9.5 + seed, "tilt" * (seed == 1)) for seed in range(3)]
    runs += [run("friction", seed, 10.1 + seed) for seed in range(3)]
    summary = summarize(runs)
    counts = [summary[name] for name in ("upright", "trials", "finished", "left_lane")]
    assert counts == [11, 20, 11, 1] and summary["falls"] == {"tilt": 9}
    assert summary["held_speed_quantiles_m_s"]["0.5"] == pytest.approx(9.5)
    first, second = summary["causes"]
    assert first["cause"] == "delay" and first["change_m_s"] == pytest.approx(-0.5) and first["upright"] == 2
    assert second["cause"] == "friction" and second["change_m_s"] == pytest.approx(0.1)
    assert png_bytes(robustness_figure(summary, runs, "made up"))[:4] == b"\x89PNG"
    fallen = summarize([run(ALL, seed, fell="tilt") for seed in range(3)])
    assert set(fallen["held_speed_quantiles_m_s"].values()) == {None} and fallen["upright"] == 0
    json.dumps(fallen, allow_nan=False)


@pytest.mark.parametrize(
    ("successes", "trials", "lower", "upper"),
    # Published values: Newcombe, Statistics in Medicine 17 (1998), table I, method 3.
    [(81, 263, 0.2553, 0.3662), (0, 20, 0.0, 0.1611)],
)
def test_wilson_interval_is_the_published_one(successes, trials, lower, upper):
    assert wilson_interval(successes, trials) == pytest.approx((lower, upper), abs=5e-5)


# --- ground ------------------------------------------------------------------------------------------------

KINDS = ("level", "uphill", "downhill", "rough")


def grounds(*speeds):
    """Numbers of three runs on each ground; None falls."""
    runs = [
        run(kind, seed, speed, fell="tilt" if speed is None else "")
        for kind, speed in zip(KINDS, speeds, strict=True)
        for seed in range(3)
    ]
    return ground_numbers(runs)["grounds"]


def test_every_ground_gets_the_protocols_trials_and_rough_ground_heights_of_its_own():
    cases = ground_cases(8.0, 2, 0.1, 0.03, PlantOptions())
    assert [case.group for case in cases] == [kind for kind in KINDS for _ in range(2)]
    drawn = ProtocolSettings(trials=2, required=1).trial_settings()
    assert [case.request.settings for case in cases] == [*drawn] * 4
    ground = [case.request.plant.ground for case in cases]
    assert [one.slope for one in ground] == [0.0, 0.0, 0.1, 0.1, -0.1, -0.1, 0.0, 0.0]
    assert [one.roughness for one in ground] == [0.0] * 6 + [0.03] * 2
    assert ground[-1].seed != ground[-2].seed


def test_a_ground_is_met_when_all_stay_upright_and_little_speed_is_lost():
    found = grounds(10.0, 8.6, 10.5, 8.4)
    assert [ground["met"] for ground in found] == [True, True, True, False]
    assert found[1]["change"] == pytest.approx(-0.14)
    fell = grounds(10.0, None, 10.0, 10.0)
    assert [ground["met"] for ground in fell] == [True, False, True, True]
    assert fell[1]["held_speed_m_s"] is fell[1]["change"] is None and fell[1]["upright"] == 0
    assert grounds(0.01, 0.02, 0.0, 0.0)[1]["change"] is None


@pytest.mark.usefixtures("brief_trials")
def test_a_policy_that_stands_stays_upright_everywhere(pool):
    told = []
    cases = ground_cases(0.5, 1, 0.05, 0.02, PlantOptions())
    found = ground_numbers(run_cases(pool, cases, lambda *now: told.append(now)))
    assert told == [(kind, done, 4) for done, kind in enumerate(KINDS, start=1)]
    assert [ground["upright"] for ground in found["grounds"]] == [1, 1, 1, 1]
    assert all(abs(ground["held_speed_m_s"]) < 0.05 for ground in found["grounds"])


# --- turning -----------------------------------------------------------------------------------------------


def turned(asked, *outcomes):
    """Numbers of turns that reach these gains, or fell."""
    return turning_numbers(
        asked,
        [
            run("", 0, turn.forward, fell="tilt")
            if gain is None
            else run("", 0, turn.forward, yaw_rate_rad_s=gain * turn.yaw_rate)
            for turn, gain in zip(asked, outcomes, strict=True)
        ],
    )


def test_commands_reach_the_friction_hyperbola_and_no_further():
    asked = turns((0.0, 4.0, 12.0))
    assert len(asked) == 3 * len(FRACTIONS)
    for turn in asked:
        assert abs(turn.yaw_rate) <= 1.0 and abs(turn.forward * turn.yaw_rate) <= 0.85 * 9.81 + 1e-3
    assert asked[-1].yaw_rate == pytest.approx(0.85 * 9.81 / 12.0, rel=1e-3)


def test_a_turn_begins_when_the_speed_is_asked_for():
    turn = Turn(-4.0, 0.5, 3.0)
    base = BaseState(forward_speed=0.0, heading=0.0, lateral_offset=0.0, distance=0.0)
    asked = [(turn.speed(time, base), turn.steer(base, 0.0)) for time in (0.5, 1.5, 2.0)]
    assert asked == [(0.0, 0.0), (-2.0, 0.0), (-4.0, 0.5)]
    assert turn.speed(5.0, base) is None


def test_the_achieved_rate_is_that_of_the_last_two_seconds(make_trajectory):
    time = np.arange(2500) / 500.0
    heading = np.where(time < 2.5, 0.0, 0.3 * (time - 2.5))
    velocity = np.stack((np.full(2500, 4.0), np.zeros(2500)), axis=-1)
    found = achieved(make_trajectory(5.0, heading=heading, velocity=velocity))
    assert found == pytest.approx((4.0, 0.3))


def test_only_moderate_turns_make_the_least_gain_and_a_fall_makes_it_undefined():
    asked, least = turns((8.0,))[-2:], "least_gain_up_to_half_of_friction"
    found, fell = turned(asked, 0.9, 0.1), turned(asked, None, 1.0)
    assert found[least] == pytest.approx(0.9) and found["falls"] == 0
    assert turning_rows(found)[0][2:] == ("90 %", "10 %")
    assert fell[least] is None and fell["falls"] == 1
    assert turning_rows(fell)[0][2] == "fell"
    (axis,) = turning_figure(fell).axes
    assert "m/s" in axis.get_xlabel() and "rad/s" in axis.get_ylabel()
