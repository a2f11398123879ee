"""Sprints with everything randomized: draws, disturbances, resuming, and what they amount to."""

import json
import math
import os
from dataclasses import replace

import numpy as np
import pytest

from sprintlab.control import Measurement, load_policy
from sprintlab.core.errors import InvalidValueError, SprintlabError
from sprintlab.core.theme import png_bytes
from sprintlab.evaluation.disturbances import SENSOR_NOISE, Disturbances
from sprintlab.evaluation.pool import TrialPool
from sprintlab.evaluation.robustness import (
    ALL,
    CAUSES,
    NOMINAL,
    StudySettings,
    draw_request,
    run_study,
    study,
    summarize,
    wilson_interval,
)
from sprintlab.evaluation.robustness.figure import robustness_figure
from sprintlab.evaluation.trial import TrialRequest, run_trial
from sprintlab.plant import Plant, PlantOptions, TrialSettings

RUN = {"top_speed": 2.0, "bus_voltage": 60.0}
SHORT = StudySettings(top_speed=2.0, trials=3, cause_trials=0, distance=0.2)


def drawn(request):
    """What a request differs in, by cause."""
    settings, plant = request.settings, request.plant
    return {
        "friction": settings.friction,
        "payload": settings.payload,
        "centre of mass": settings.center_of_mass,
        "strength": settings.strength,
        "bus voltage": plant.bus_voltage,
        "delay": settings.delay,
        "sensor noise": settings.sensor_noise,
        "joint offsets": settings.joint_offset,
        "pushes": settings.push_speed,
        "foot": plant.foot,
    }


BANDS = {
    "friction": (0.5, 1.2),
    "payload": (-1.0, 4.0),
    "strength": (0.9, 1.0),
    "bus voltage": (54.0, 60.0),
    "delay": (0.0, 0.010),
}


def test_everything_varies_over_its_whole_band():
    draws = [drawn(draw_request(seed, ALL, **RUN)) for seed in range(300)]
    for cause, (low, high) in BANDS.items():
        values = np.array([draw[cause] for draw in draws])
        assert values.min() >= low and values.max() <= high
        assert values.min() < low + 0.05 * (high - low) and values.max() > high - 0.05 * (high - low)
    shift = np.array([draw["centre of mass"] for draw in draws])
    assert (
        np.abs(shift).max() <= 0.03
        and (shift.max(axis=0) > 0.028).all()
        and (shift.min(axis=0) < -0.028).all()
    )
    stiffness = np.array([draw["foot"].stiffness for draw in draws])
    assert 40e3 <= stiffness.min() < 43e3 and 150e3 < stiffness.max() <= 160e3
    assert np.median(stiffness) == pytest.approx(80e3, rel=0.15)
    restitution = np.array([draw["foot"].restitution for draw in draws])
    assert 0.2 <= restitution.min() < 0.22 and 0.58 < restitution.max() <= 0.6
    assert {draw["sensor noise"] for draw in draws} == {1.0}
    assert {(draw["joint offsets"], draw["pushes"]) for draw in draws} == {(0.02, 0.5)}


@pytest.mark.parametrize("cause", CAUSES)
def test_a_cause_alone_is_drawn_as_together_with_the_others_and_nothing_else_is(cause):
    alone, together = (drawn(draw_request(7, group, **RUN)) for group in (cause, ALL))
    nominal = drawn(draw_request(7, NOMINAL, **RUN))
    assert alone[cause] == together[cause] != nominal[cause]
    assert {name: alone[name] for name in CAUSES if name != cause} == {
        name: nominal[name] for name in CAUSES if name != cause
    }


def test_the_same_seed_gives_the_same_sprint_and_another_seed_another():
    assert draw_request(3, ALL, **RUN) == draw_request(3, ALL, **RUN)
    assert draw_request(3, ALL, **RUN) != draw_request(4, ALL, **RUN)


def test_an_unknown_group_is_refused():
    with pytest.raises(InvalidValueError, match="gravity"):
        draw_request(0, "gravity", **RUN)


# --- disturbances ------------------------------------------------------------------------------------------


@pytest.fixture
def reading():
    return Measurement(np.zeros(3), np.zeros(3), np.zeros(12), np.zeros(12))


def test_without_disturbances_everything_passes_unchanged(robot, reading):
    calm = Disturbances(robot, TrialSettings(), 1000.0)
    for value, was in zip(calm.measured(reading), reading, strict=True):
        np.testing.assert_array_equal(value, was)
    targets = np.arange(12.0)
    for _ in range(2):
        ((held, steps),) = calm.delivered(targets, 20)
        assert steps == 20 and (held == targets).all()


def test_noise_fills_its_band_and_follows_the_seed(robot, reading):
    def readings(seed):
        noisy = Disturbances(robot, TrialSettings(seed=seed, sensor_noise=2.0), 1000.0)
        return [noisy.measured(reading) for _ in range(500)]

    for name, width in SENSOR_NOISE._asdict().items():
        values = np.array([getattr(one, name) for one in readings(1)])
        assert np.abs(values).max() <= 2.0 * width and values.std() == pytest.approx(
            2.0 * width / math.sqrt(3.0), rel=0.05
        )
    np.testing.assert_array_equal(readings(1)[7].joint_velocity, readings(1)[7].joint_velocity)
    assert (readings(1)[7].joint_velocity != readings(2)[7].joint_velocity).any()


def test_an_encoder_offset_shifts_reading_and_target_against_each_other(robot, reading):
    offset = Disturbances(robot, TrialSettings(seed=5, joint_offset=0.02), 1000.0)
    read = offset.measured(reading).joint_position
    ((held, _),) = offset.delivered(np.zeros(12), 20)
    assert 0.005 < np.abs(read).max() <= 0.02
    np.testing.assert_allclose(held, -read)


def test_targets_arrive_late(robot):
    late = Disturbances(robot, TrialSettings(delay=0.0072), 1000.0)
    first, second = np.zeros(12), np.ones(12)
    assert [steps for _, steps in late.delivered(first, 20)] == [20]
    parts = list(late.delivered(second, 20))
    assert [(held[0], steps) for held, steps in parts] == [(0.0, 7), (1.0, 13)]


def test_pushes_have_their_size_their_rate_and_every_direction(robot):
    class Trunk:
        time, changes = 2.0, []

        def push(self, change):
            self.changes.append(change)

    pushed = Disturbances(robot, TrialSettings(push_speed=0.5, push_interval=2.0), 1000.0)
    for _ in range(20_000):
        pushed.push(Trunk(), 20)
    changes = np.array(Trunk.changes)
    np.testing.assert_allclose(np.linalg.norm(changes, axis=1), 0.5)
    assert len(changes) == pytest.approx(200, rel=0.25)
    assert (changes.max(axis=0) > 0.4).all() and (changes.min(axis=0) < -0.4).all()


def test_the_plant_is_as_heavy_weak_and_lopsided_as_the_trial_says(robot):
    settings = TrialSettings(center_of_mass=(0.02, -0.01, 0.03), strength=0.9)
    nominal, changed = (Plant(robot, PlantOptions(), chosen) for chosen in (TrialSettings(), settings))
    trunk = nominal.model.body("trunk").id
    np.testing.assert_allclose(
        changed.model.body_ipos[trunk] - nominal.model.body_ipos[trunk], (0.02, -0.01, 0.03)
    )

    class Blind:
        def sample(self, data, drive, targets):
            pass

        def watch_step(self, data):
            pass

    given = [plant.drive_joints(np.full(12, 5.0), np.zeros(12), Blind()) for plant in (nominal, changed)]
    np.testing.assert_allclose(given[1].torque, 0.9 * given[0].torque)
    np.testing.assert_allclose(changed.data.ctrl, given[1].torque)
    before = changed.data.qvel[:2].copy()
    changed.push(np.array([0.3, -0.4]))
    np.testing.assert_allclose(changed.data.qvel[:2] - before, (0.3, -0.4))


@pytest.mark.usefixtures("short_trials")
def test_a_push_moves_a_standing_robot(standing_policy, robot):
    policy = load_policy(standing_policy)
    settings = TrialSettings(push_speed=0.5, push_interval=0.3)
    fastest = [
        np.abs(run_trial(policy, robot, request).trajectory.velocity).max()
        for request in (
            TrialRequest(top_speed=0.5, hold=1.0, keep_trajectory=True, settings=chosen)
            for chosen in (TrialSettings(), settings)
        )
    ]
    assert fastest[0] < 0.2 and fastest[1] > 0.25


# --- the study ---------------------------------------------------------------------------------------------


@pytest.mark.usefixtures("short_trials")
def test_killed_and_resumed_equals_uninterrupted(standing_policy, robot, tmp_path):
    class Kill(Exception):
        pass

    def kill_after_the_first(done, total):
        assert total == 3
        if done == 1:
            raise Kill

    with TrialPool(standing_policy, robot, workers=1) as pool:
        whole = run_study(pool, SHORT, tmp_path / "whole")
        with pytest.raises(Kill):
            run_study(pool, SHORT, tmp_path / "cut", kill_after_the_first)
        kept = {path.name for path in (tmp_path / "cut").iterdir()}
        assert kept == {"study.json", "all-000000.json"}
        told = []
        resumed = run_study(pool, SHORT, tmp_path / "cut", lambda *now: told.append(now))
        assert told == [(1, 3), (2, 3), (3, 3)]
        more = run_study(pool, replace(SHORT, trials=4), tmp_path / "cut")
    assert resumed == whole == more[:3] and len(more) == 4
    for path in (tmp_path / "whole").iterdir():
        assert path.read_bytes() == (tmp_path / "cut" / path.name).read_bytes()


@pytest.mark.usefixtures("short_trials")
def test_a_policy_that_falls_is_counted(make_policy, robot, tmp_path):
    policy = make_policy(np.tile([0.0, 3.0, -5.0], 4))
    with TrialPool(policy, robot, workers=1) as pool:
        pieces = run_study(pool, replace(SHORT, cause_trials=1), tmp_path)
    summary = summarize(pieces)
    assert summary["trials"] == 3 and summary["upright"] == 0 and summary["finished"] == 0
    assert summary["share_upright"] == 0.0 and summary["interval_95"][1] < 0.6
    assert sum(summary["falls"].values()) == 3 and "" not in summary["falls"]
    assert set(summary["held_speed_quantiles_m_s"].values()) == {None}
    assert {row["cause"] for row in summary["causes"]} == set(CAUSES)
    json.dumps(summary, allow_nan=False)
    assert png_bytes(robustness_figure(summary, pieces, "fallen"))[:4] == b"\x89PNG"


@pytest.mark.usefixtures("short_trials")
@pytest.mark.parametrize(
    ("changes", "named"),
    [({"top_speed": 3.0}, "top_speed"), ({"distance": 0.3, "top_speed": 1.0}, "top_speed and distance")],
)
def test_a_folder_of_another_study_is_refused(standing_policy, robot, tmp_path, changes, named):
    with TrialPool(standing_policy, robot, workers=1) as pool:
        run_study(pool, replace(SHORT, trials=1), tmp_path)
        with pytest.raises(SprintlabError, match=f"another {named}"):
            run_study(pool, replace(SHORT, **changes), tmp_path)


@pytest.mark.usefixtures("short_trials")
@pytest.mark.parametrize("text", ["{", "[]", '{"group": "all", "seed": 9}'])
def test_a_broken_or_strange_file_is_refused_by_name(standing_policy, robot, tmp_path, text):
    with TrialPool(standing_policy, robot, workers=1) as pool:
        run_study(pool, replace(SHORT, trials=1), tmp_path)
        (tmp_path / "all-000001.json").write_text(text)
        with pytest.raises(SprintlabError, match=r"all-000001\.json .*remove it"):
            run_study(pool, SHORT, tmp_path)


@pytest.mark.parametrize(
    "change",
    [
        {"upright": "yes"},
        {"fall_reason": []},
        {"held_speed_m_s": "fast"},
        {"held_speed_m_s": True},
        {"held_speed_m_s": 1.7e308},
        {"time_s": -1e7},
        {"without": "held_speed_m_s"},
        None,
    ],
)
def test_a_sprint_with_impossible_numbers_is_refused(tmp_path, change):
    piece = {"group": "all", "seed": 1, "upright": True, "left_lane": False, "fall_reason": ""}
    piece |= {"time_s": 10.0, "held_speed_m_s": None}
    path = tmp_path / "all-000001.json"
    path.write_text(json.dumps(piece))
    assert study._read(tmp_path, "all", 1) == piece
    path.unlink()
    if change is None:
        os.mkfifo(path)
    else:
        piece |= change
        piece.pop(piece.get("without"), None)
        path.write_text(json.dumps(piece))
    with pytest.raises(SprintlabError, match="remove it"):
        study._read(tmp_path, "all", 1)


@pytest.mark.parametrize("text", ["[]", "5", None])
def test_a_folder_that_says_nothing_of_its_study_is_refused(tmp_path, text):
    if text is None:
        os.mkfifo(tmp_path / "study.json")
    else:
        (tmp_path / "study.json").write_text(text)
    with pytest.raises(SprintlabError, match=r"another policy|not a regular file"):
        study.check_identity(tmp_path, {"policy": "a"})
    assert study.known_top_speed(tmp_path) is None


def test_a_folder_with_other_files_is_refused(standing_policy, robot, tmp_path):
    (tmp_path / "letter.txt").write_text("mine")
    with (
        TrialPool(standing_policy, robot, workers=1) as pool,
        pytest.raises(SprintlabError, match="other files"),
    ):
        run_study(pool, SHORT, tmp_path)


# --- what it amounts to ------------------------------------------------------------------------------------


def piece(group, seed, speed, upright=True):
    return {
        "group": group,
        "seed": seed,
        "upright": upright,
        "fall_reason": "" if upright else "tilt",
        "fall_time_s": None if upright else 3.0,
        "time_s": 10.0 if upright else None,
        "left_lane": seed == 0,
        "held_speed_m_s": speed if upright else None,
        "distance_m": 100.0,
        "drawn": {},
    }


def test_shares_quantiles_and_costs_of_made_up_sprints():
    pieces = [piece(ALL, seed, 9.0 + 0.1 * seed, upright=seed < 11) for seed in range(20)]
    pieces += [piece(NOMINAL, seed, 10.0 + seed) for seed in range(3)]
    pieces += [piece("delay", seed, 9.5 + seed, upright=seed != 1) for seed in range(3)]
    pieces += [piece("friction", seed, 10.1 + seed) for seed in range(3)]
    summary = summarize(pieces)
    assert (summary["upright"], summary["trials"], summary["finished"], summary["left_lane"]) == (
        11,
        20,
        11,
        1,
    )
    assert summary["falls"] == {"tilt": 9}
    assert summary["held_speed_quantiles_m_s"]["0.5"] == pytest.approx(9.5)
    first, second = summary["causes"]
    assert first["cause"] == "delay" and first["change_m_s"] == pytest.approx(-0.5) and first["upright"] == 2
    assert second["cause"] == "friction" and second["change_m_s"] == pytest.approx(0.1)


@pytest.mark.parametrize(
    ("successes", "trials", "lower", "upper"),
    # Published values: Newcombe, Statistics in Medicine 17 (1998), table I, method 3.
    [(81, 263, 0.2553, 0.3662), (15, 148, 0.0624, 0.1605), (0, 20, 0.0, 0.1611), (1, 29, 0.0061, 0.1718)],
)
def test_wilson_interval_is_the_published_one(successes, trials, lower, upper):
    assert wilson_interval(successes, trials) == pytest.approx((lower, upper), abs=5e-5)


def test_an_interval_of_no_trials_is_refused():
    with pytest.raises(InvalidValueError, match="trials"):
        wilson_interval(0, 0)
