"""The curricula of other papers against plain loops, in NumPy and PyTorch, and their schedules' commands."""

from __future__ import annotations

import math

import numpy as np
import pytest

from sprintlab.commands import (
    BoxGrid,
    CommandStep,
    CurriculumSchedule,
    ProgressGrid,
    RampedSchedule,
    TargetOutcome,
    TargetSampling,
    initial_state,
)

RANGE = {"speed": (-1.0, 4.0), "speed_bin": 1.0, "yaw_limit": 1.0, "yaw_bins": 3}
ROWS, COLUMNS, ROBOTS = 5, 3, 40
GRIDS = (BoxGrid(**RANGE), ProgressGrid(**RANGE, stage_steps=4))


def outcomes(steps: int, seed: int = 0) -> list[TargetOutcome]:
    """Random outcomes of robots, a third of them due or failed in each step."""
    random = np.random.default_rng(seed)
    made = []
    for _ in range(steps):
        kind = random.random(ROBOTS)
        made.append(
            TargetOutcome(
                speed=random.uniform(-1.0, 4.0, ROBOTS),
                yaw_rate=random.uniform(-1.0, 1.0, ROBOTS),
                speed_error=random.normal(0.0, 0.5, ROBOTS),
                yaw_error=random.normal(0.0, 0.5, ROBOTS),
                tracking=random.random((ROBOTS, 2)) ** 0.3,
                due=kind < 0.2,
                failed=kind > 0.9,
            )
        )
    return made


def in_bin(outcome: TargetOutcome, robot: int) -> tuple[int, int]:
    row = math.floor(outcome.speed[robot] + 1.0)
    return min(row, ROWS - 1), min(math.floor((outcome.yaw_rate[robot] + 1.0) / (2.0 / 3.0)), COLUMNS - 1)


def box_by_hand(steps: list[TargetOutcome], grid: BoxGrid) -> np.ndarray:
    """A bin whose target was tracked gains twice, its neighbours once, and none loses."""
    weights = np.zeros((ROWS, COLUMNS))
    weights[[0, 1]] = 1.0  # middles at -0.5 and 0.5 m/s
    for step in steps:
        gained = np.zeros_like(weights)
        for robot in range(ROBOTS):
            linear, angular = step.tracking[robot]
            if not (step.due[robot] and linear > grid.linear_success and angular > grid.angular_success):
                continue
            row, column = in_bin(step, robot)
            gained[row, column] = 2 * grid.gain
            for near_row in range(max(0, row - 1), min(ROWS, row + 2)):
                for near in range(max(0, column - 1), min(COLUMNS, column + 2)):
                    gained[near_row, near] = max(gained[near_row, near], grid.gain)
        weights = np.minimum(1.0, weights + gained)
    return weights


def progress_by_hand(steps: list[TargetOutcome], grid: ProgressGrid) -> np.ndarray:
    before = {place: 0.0 for place in np.ndindex(ROWS, COLUMNS)}
    rewards = {place: [] for place in before}
    chosen = np.full((ROWS, COLUMNS), 1.0 / (ROWS * COLUMNS))
    for number, step in enumerate(steps, 1):
        for robot in range(ROBOTS):
            if step.due[robot] or step.failed[robot]:
                linear, angular = step.tracking[robot]
                rewards[in_bin(step, robot)].append((linear + 0.5 * angular) / 1.5)
        if number % grid.stage_steps == 0:
            means = {
                place: sum(found) / len(found) if found else before[place] for place, found in rewards.items()
            }
            grown = {place: math.exp((means[place] - before[place]) / grid.temperature) for place in means}
            for place, value in grown.items():
                chosen[place] = value / sum(grown.values())
            before, rewards = means, {place: [] for place in means}
    return chosen


BY_HAND = (box_by_hand, progress_by_hand)


@pytest.mark.parametrize(("grid", "by_hand"), list(zip(GRIDS, BY_HAND, strict=True)))
def test_each_rule_is_that_of_a_plain_loop_also_in_torch_without_a_look_into_a_value(
    grid, by_hand, torch
) -> None:
    steps = outcomes(1 if grid is GRIDS[0] else 10)  # the box is soon open everywhere
    first = memory = grid.initial_weights(np.zeros(1))
    tensor = grid.initial_weights(torch.zeros(1).double())
    meta = tensor.to("meta")
    for step in steps:
        memory = grid.update(memory, step)
        tensors = TargetOutcome(*(torch.tensor(value) for value in step))
        tensor = grid.update(tensor, tensors)
        meta = grid.update(meta, TargetOutcome(*(value.to("meta") for value in tensors)))
    np.testing.assert_allclose(tensor.numpy(), memory, atol=1e-12)
    expected = by_hand(steps, grid)
    np.testing.assert_allclose(grid.probabilities(memory), expected, atol=1e-12)
    assert np.abs(expected - grid.probabilities(first)).max() > 1e-4 and np.ptp(expected) > 1e-4


def advanced(schedule, steps: int, **changes):
    random = np.random.default_rng(2)
    n = 500
    state = initial_state(n, np.zeros(1))
    grid = schedule.targets.grid
    arguments = {
        "speed": np.zeros(n), "dt": 0.02, "lower": -1.0, "upper": 2.0, "friction": 1.0,
        "weights": None if grid is None else grid.initial_weights(np.zeros(1)), **changes,
    }  # fmt: skip
    states = []
    for number in range(steps):
        reset_mask = np.full(n, number == 0)
        step = CommandStep(reset_mask=reset_mask, random=random.random((n, 8)), **arguments)
        state = schedule.advance(state, step)
        states.append(state)
    return states


def test_a_curriculum_is_commanded_at_once_over_its_own_range() -> None:
    grid = ProgressGrid(**RANGE)
    schedule = CurriculumSchedule(targets=TargetSampling(top_share=0.0, grid=grid))
    (state,) = advanced(schedule, 1)
    np.testing.assert_allclose(state.command[:, 0], state.target_speed)
    assert state.target_speed.max() > 3.5  # beyond the range that grows
    assert (state.target_yaw_rate == 0.0).mean() == pytest.approx(0.55, abs=0.06)  # and who stands


def test_a_ramp_takes_its_time_whatever_the_target() -> None:
    schedule = RampedSchedule(targets=TargetSampling(top_share=0.0, grid=None, persistence=(5.0, 5.0)))
    states = advanced(schedule, 60)
    target = states[0].target_speed
    np.testing.assert_allclose(states[24].command[:, 0], 0.5 * target, atol=1e-9)
    np.testing.assert_allclose(states[50].command[:, 0], target, atol=1e-9)
