"""The search for the highest speed and the pool of workers."""

import hashlib
import os
import shutil
import time
from concurrent.futures.process import BrokenProcessPool
from dataclasses import replace
from types import SimpleNamespace
from typing import NamedTuple

import numpy as np
import pytest
from tests.short_trials import COARSE

from sprintlab.core.errors import PolicyFileError, SimulationError
from sprintlab.evaluation.pool import TrialPool, WorkerProcesses
from sprintlab.evaluation.protocol import (
    ProtocolSettings,
    run_protocol,
    run_protocol_near,
    run_speed,
    search_speeds,
)
from sprintlab.evaluation.race import find_top_speed
from sprintlab.evaluation.results import ProtocolResult, SpeedResult

SHORT = ProtocolSettings(trials=2, required=2, start=0.5, top=0.75, hold=0.5, plant=COARSE)


class FakePool:
    """Runs nothing: at a speed as many trials fall as ``falls`` says.

    Beyond ``limit`` less is held, beyond ``honest`` feet sink deep.
    """

    def __init__(self, make_trial, falls, limit=50.0, honest=50.0):
        self.make_trial, self.falls, self.limit, self.honest = make_trial, falls, limit, honest
        self.asked = []

    def trials(self, requests, most_falls=None):
        self.asked += [request.top_speed for request in requests]
        speed, falls = requests[0].top_speed, self.falls
        return [
            self.make_trial(
                request.top_speed,
                completed=index >= falls(request.top_speed),
                held_speed=min(request.top_speed, 2 * self.limit - request.top_speed) - 0.1,
                angular_cost=speed,
                pad_deflection=0.001 if request.top_speed <= self.honest else 0.1,
            )
            for index, request in enumerate(requests)
        ]


@pytest.mark.parametrize(("near", "begun"), [(3.0, [3.0]), (9.0, [4.0, 1.0]), (-2.0, [1.0])])
def test_a_search_near_a_speed_begins_at_the_lowest_after_all_where_it_falls_there(make_trial, near, begun):
    pool = FakePool(make_trial, lambda speed: int(speed > 3.0) * 10)
    result = run_protocol_near(near, pool, ProtocolSettings(grid=1.0, top=4.0))
    lowest = [speed for before, speed in zip([50.0, *pool.asked], pool.asked, strict=False) if speed < before]
    assert lowest == begun and result.best.top_speed == 3.0


def test_a_search_near_a_speed_begins_at_the_lowest_where_the_robot_does_not_come_to_rest_there(make_trial):
    class Restless(FakePool):
        def trials(self, requests, most_falls=None):
            rests = requests[0].top_speed < 2.5
            return [replace(one, completed=rests) for one in super().trials(requests, most_falls)]

    pool = Restless(make_trial, lambda speed: 0)
    result = run_protocol_near(3.0, pool, ProtocolSettings(grid=1.0, top=4.0))
    assert (result.best.top_speed, result.running.top_speed) == (2.0, 4.0)


def test_the_search_stops_at_the_first_speed_that_fails(make_trial):
    pool = FakePool(make_trial, lambda speed: 2 if speed == 1.75 else int(speed == 1.5))
    result = run_protocol(pool, self_paced=False)
    assert [speed.top_speed for speed in result.speeds] == [1.0, 1.25, 1.5, 1.75]
    assert result.best.top_speed == 1.5 and result.best.falls == 1
    assert result.mean("held_speed") == pytest.approx(1.4)


def test_the_fastest_is_not_always_at_the_highest_command(make_trial):
    pool = FakePool(make_trial, lambda speed: 2 if speed > 9.5 else 0, limit=7.3)
    result = run_protocol(pool, self_paced=False)
    assert result.best.top_speed == 9.5 and result.mean("held_speed") == pytest.approx(5.0)
    assert result.fastest.top_speed == 7.25 and result.fastest.mean("held_speed") == pytest.approx(7.15)


def test_running_and_stopping_are_two_results():
    """From 3 to 5 m/s a robot runs and does not rest; from 6 m/s on it falls."""

    class Tried(NamedTuple):
        speed: float
        passed: bool
        ran: bool

    for top, last in ((9.0, 6.0), (4.0, 4.0)):
        settings = ProtocolSettings(start=1.0, top=top, grid=1.0)
        tried = search_speeds(settings, lambda speed: Tried(speed, speed < 3.0, speed < 6.0))
        assert [one.speed for one in tried] == list(np.arange(1.0, last + 1.0))


def test_a_coarse_search_looks_closer_where_it_falls_and_where_it_does_not_come_to_rest():
    """It rests up to 4.5 m/s and runs up to 7.5 m/s."""

    def run(speed):
        return SimpleNamespace(speed=speed, passed=speed < 5.0, ran=speed < 8.0)

    settings = ProtocolSettings(start=1.0, top=16.0, grid=0.5, first_step=2.0)
    tried = [one.speed for one in search_speeds(settings, run)]
    assert tried == [1.0, 3.0, 3.5, 4.0, 4.5, 5.0, 7.0, 7.5, 8.0, 9.0]


def test_both_tops_are_told(make_trial):
    def tried(speed, rests):
        trial = replace(make_trial(speed, held_speed=speed), completed=rests)
        return SpeedResult(top_speed=speed, self_paced=False, trials=(trial,), required=1)

    result = ProtocolResult(self_paced=False, speeds=(tried(2.0, True), tried(3.0, False), tried(4.0, False)))
    assert result.best.top_speed == 2.0 and result.mean("held_speed") == 2.0
    assert result.running.top_speed == 4.0 and result.running.running_speed == 4.0


@pytest.mark.parametrize(
    ("limit", "honest", "expected"),
    [
        (9.6, 50.0, 9.5),
        (9.0, 50.0, 9.0),
        (0.2, 50.0, 1.0),
        (9.5, 6.6, 6.5),
        (9.5, 0.0, 9.5),
    ],
)
def test_the_short_cut_finds_the_highest_speed_that_the_audit_passes_if_any(
    make_trial, limit, honest, expected
):
    pool = FakePool(make_trial, lambda speed: 10 if speed > limit else 0, honest=honest)
    assert find_top_speed(pool) == expected


def test_every_speed_gets_the_same_varied_trials():
    first, second = (ProtocolSettings().requests(speed, False) for speed in (3.0, 4.0))
    assert [request.settings for request in first] == [request.settings for request in second]
    settings = [request.settings for request in first]
    friction, payload = (
        np.array([getattr(one, name) for one in settings]) for name in ("friction", "payload")
    )
    assert friction.min() >= 0.7 and friction.max() <= 1.0 and np.ptp(friction) > 0.1
    assert np.abs(payload).max() <= 1.0 and np.ptp(payload) > 0.5
    assert [request.keep_trajectory for request in first] == [True] + [False] * 9


@pytest.fixture(scope="module")
def two_workers():
    """Their start takes longer than what most tests ask of them."""
    with WorkerProcesses(2) as processes:
        yield processes


def test_workers_give_the_same_numbers_as_one_process(standing_policy, robot, two_workers):
    with TrialPool(standing_policy, robot, workers=1) as pool:
        alone = run_speed(pool, 0.5, self_paced=False, settings=SHORT)
    with TrialPool(standing_policy, robot, processes=two_workers) as pool:
        together = run_speed(pool, 0.5, self_paced=False, settings=SHORT)
    assert alone.falls == together.falls == 0
    assert [trial.metrics.angular_cost for trial in alone.trials] == [
        trial.metrics.angular_cost for trial in together.trials
    ]
    assert together.trials[0].trajectory is not None and together.trials[1].trajectory is None


def test_a_speed_is_given_up_at_the_fall_that_decides_it(make_policy, robot, two_workers):
    falling = make_policy(np.tile([0.0, 3.0, -5.0], 4))
    requests = ProtocolSettings(trials=5, required=4).requests(1.0, False)
    for processes in (None, two_workers):
        with TrialPool(falling, robot, workers=1, processes=processes) as pool:
            assert [trial.completed for trial in pool.trials(requests, most_falls=1)] == [False, False]


def test_a_policy_that_takes_the_place_of_another_is_not_run_for_it(
    standing_policy, make_policy, robot, two_workers, tmp_path
):
    """A training writes its policy again, say: the numbers would be of both."""
    path = tmp_path / "policy.onnx"
    shutil.copy(standing_policy, path)
    for processes in (None, two_workers):
        with TrialPool(path, robot, workers=1, processes=processes) as pool:
            digest = pool.policy.digest
            assert digest == hashlib.sha256(path.read_bytes()).hexdigest()
            shutil.copy(make_policy(np.tile([0.0, 3.0, -5.0], 4)), path)
            with pytest.raises(PolicyFileError, match="has changed since the run began"):
                run_speed(pool, 0.5, self_paced=False, settings=SHORT)
            assert pool.policy.digest == digest
        shutil.copy(standing_policy, path)


def test_an_error_in_a_worker_arrives_as_it_was(make_policy, robot, two_workers):
    broken = make_policy(np.full(12, np.nan))
    with (
        TrialPool(broken, robot, processes=two_workers) as pool,
        pytest.raises(SimulationError, match="seed 0"),
    ):
        run_speed(pool, 0.5, self_paced=False, settings=SHORT)


def test_who_is_interrupted_does_not_wait_for_what_runs():
    with pytest.raises(KeyboardInterrupt), WorkerProcesses(2) as processes:
        processes._executor.submit(os.getpid).result()
        started = processes._executor.submit(time.sleep, 10_000.0)
        while not started.running():
            time.sleep(0.01)
        raise KeyboardInterrupt
    assert isinstance(started.exception(), BrokenProcessPool)
