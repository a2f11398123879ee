import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sprintlab.commands import (
    AdaptiveSchedule,
    CommandStep,
    FixedAccelerationSchedule,
    TargetSampling,
    UniformSchedule,
    initial_state,
    limit_yaw_rate,
)

SCHEDULES = (AdaptiveSchedule(), UniformSchedule(), FixedAccelerationSchedule())
DT = 0.02


def draw_inputs(generator, n, lower=-2.0, upper=9.0, fresh_share=0.0):
    return {
        "speed": generator.uniform(lower, upper, n),
        "friction": generator.uniform(0.3, 1.0, n),
        "reset_mask": generator.random(n) < fresh_share,
        "random": generator.random((n, 8)),
    }


def advance(schedule, state, inputs, lower=-2.0, upper=9.0, steady=1.0):
    return schedule.advance(state, CommandStep(dt=DT, lower=lower, upper=upper, steady=steady, **inputs))


def as_torch(inputs):
    torch = pytest.importorskip("torch")
    return {name: torch.from_numpy(value) for name, value in inputs.items()}


@pytest.mark.parametrize("schedule", SCHEDULES, ids=lambda schedule: type(schedule).__name__)
def test_numpy_equals_torch(schedule, torch):
    generator = np.random.default_rng(1)
    here, there = initial_state(200, np.zeros(1)), initial_state(200, torch.zeros(1, dtype=torch.float64))
    for _ in range(120):
        inputs = draw_inputs(generator, 200, fresh_share=0.05)
        here, there = advance(schedule, here, inputs), advance(schedule, there, as_torch(inputs))
        for mine, other in zip(here, there, strict=True):
            assert isinstance(other, torch.Tensor)
            np.testing.assert_allclose(mine, other.numpy(), rtol=0, atol=1e-12)


@settings(max_examples=30)
@given(
    seed=st.integers(0, 2**32 - 1),
    upper=st.floats(1.0, 14.0),
    window=st.floats(0.2, 2.0),
    braking_window=st.floats(0.2, 6.0),
    fresh_share=st.sampled_from([0.0, 0.2, 1.0]),
)
def test_adaptive_command_is_in_the_neighbourhood_and_the_range(
    seed, upper, window, braking_window, fresh_share
):
    generator = np.random.default_rng(seed)
    lower = max(-2.0, -max(1.0, upper / 3))
    schedule = AdaptiveSchedule(window=window, braking_window=braking_window)
    state = initial_state(40, np.zeros(1))
    for _ in range(30):
        inputs = draw_inputs(generator, 40, lower - 2, upper + 2, fresh_share)
        before, state = state, advance(schedule, state, inputs, lower, upper)
        command, speed = state.command[:, 0], inputs["speed"]
        updated = state.time_to_update != before.time_to_update - DT
        nearest = np.clip(speed, lower, upper)
        assert np.all(command >= lower) and np.all(command <= upper)
        assert np.all((command - nearest)[updated] <= window + 1e-12)
        assert np.all((nearest - command)[updated] <= max(window, braking_window) + 1e-12)
        assert np.all(command[~updated] == before.command[~updated, 0])
        assert np.all(updated[inputs["reset_mask"]])
        assert np.all(np.abs(command * state.command[:, 2]) <= inputs["friction"] * 9.81 + 1e-9)
        assert np.all(state.command[:, 1] == 0.0)


def test_adaptive_command_walks_a_perfect_robot_to_its_target():
    generator = np.random.default_rng(5)
    schedule = AdaptiveSchedule(targets=TargetSampling(persistence=(60.0, 60.0), yaw_share=0.0))
    state, speed = initial_state(300, np.zeros(1)), np.zeros(300)
    distances = []
    for _ in range(1000):
        inputs = draw_inputs(generator, 300) | {"speed": speed}
        state = advance(schedule, state, inputs)
        speed = speed + np.clip(state.command[:, 0] - speed, -4 * DT, 4 * DT)
        distances.append(np.mean(np.abs(state.target_speed - speed)))
    assert distances[0] > 3.0
    assert np.mean(distances[-200:]) < 0.3


def test_a_lower_target_may_draw_the_command_further_than_a_higher_one():
    schedule = AdaptiveSchedule(
        targets=TargetSampling(zero_share=0.35, persistence=(60.0, 60.0)),
        braking_window=4.0,
        biased_share=1.0,
    )
    inputs = draw_inputs(np.random.default_rng(2), 400, fresh_share=1.0) | {"speed": np.full(400, 6.0)}
    state = advance(schedule, initial_state(400, np.zeros(1)), inputs)
    at_rest, above = state.target_speed == 0.0, state.target_speed > 7.0
    assert at_rest.sum() > 50 and above.sum() > 50
    window = 1.0 + 3.0 * inputs["random"][:, 5]
    np.testing.assert_allclose(state.command[at_rest, 0], (6.0 - window)[at_rest])
    assert state.command[at_rest, 0].min() < 2.2
    assert np.all(state.command[above, 0] == 7.0)
    before = advance(schedule, initial_state(400, np.zeros(1)), inputs, steady=0.0)
    assert np.all(before.command[at_rest, 0] == 5.0), "before the fine-tuning phase: as far down as up"
    assert np.array_equal(before.command[above], state.command[above])


@pytest.mark.parametrize("keeps_rest", [False, True])
def test_a_robot_that_is_to_rest_is_disturbed_unless_its_rest_is_kept(keeps_rest):
    schedule = AdaptiveSchedule(keeps_rest=keeps_rest, targets=TargetSampling(top_share=0.0, zero_share=1.0))
    generator = np.random.default_rng(5)
    state, commands = initial_state(200, np.zeros(1)), []
    for _ in range(100):
        state = advance(schedule, state, draw_inputs(generator, 200) | {"speed": np.zeros(200)})
        commands.append(state.command[:, 0])
    assert (np.abs(commands).max() == 0.0) == keeps_rest


def test_turns_use_their_share_of_the_friction():
    schedule = AdaptiveSchedule(
        targets=TargetSampling(turn_share=0.5, yaw_share=1.0, top_share=0.9, grid=None)
    )
    inputs = draw_inputs(np.random.default_rng(14), 2000, fresh_share=1.0)
    state = advance(schedule, initial_state(2000, np.zeros(1)), inputs)
    used = np.abs(state.command[:, 0] * state.command[:, 2]) / (9.81 * inputs["friction"])
    assert used.max() == pytest.approx(0.5)


@given(st.floats(-1.0, 1.0), st.floats(-2.0, 14.0), st.floats(0.5, 1.2))
def test_scaled_turns_keep_their_share_of_what_friction_allows(share, speed, friction):
    targets = TargetSampling(scaled_turns=True, turn_share=0.8)
    turn = targets.turn(np.array([share]), np.array([speed]), np.array([friction]))
    fastest = targets.turn(np.array([1.0]), np.array([speed]), np.array([friction]))
    np.testing.assert_allclose(turn, share * fastest, atol=1e-12)
    assert abs(speed * fastest[0]) <= 0.8 * friction * 9.81 + 1e-9


def test_target_distribution():
    targets = TargetSampling(top_share=0.4, backward_share=0.2, slow_share=0.1)
    random = np.random.default_rng(8).random((100_000, 8))
    speed, kind = targets.speed(random, -2.0, 10.0), random[:, 1]
    assert speed.min() >= -2.0 and speed.max() <= 10.0
    assert np.mean(speed == 0.0) == pytest.approx(targets.zero_share, abs=0.003)
    backward = speed[(kind >= 0.7) & (kind < 0.9)]
    assert np.all(backward <= 0.0) and backward.mean() == pytest.approx(-1.0, abs=0.02)
    slow = speed[(kind >= 0.6) & (kind < 0.7)]
    assert np.all(slow >= 0.0) and slow.mean() == pytest.approx(1.25, abs=0.02)
    uniform_share = 1.0 - targets.top_share - targets.zero_share - targets.backward_share - targets.slow_share
    top = 10.0 * (1.0 - targets.top_fraction)
    wanted = targets.top_share + uniform_share * (10.0 - top) / 12
    assert np.mean(speed >= top) == pytest.approx(wanted, abs=0.006)
    yaw_rate = targets.yaw_rate(random)
    assert np.mean(yaw_rate == 0.0) == pytest.approx(0.5, abs=0.006)
    assert -1.0 <= yaw_rate.min() < -0.99 and 0.99 < yaw_rate.max() <= 1.0


def test_targets_persist_until_their_time_is_over():
    generator = np.random.default_rng(9)
    schedule = UniformSchedule(targets=TargetSampling(zero_share=0.0))
    state = initial_state(100, np.zeros(1))
    for _ in range(400):
        before, state = state, advance(schedule, state, draw_inputs(generator, 100))
        over = before.time_to_target - DT <= 0.0
        assert np.all(state.target_speed[~over] == before.target_speed[~over])
        assert np.all(state.target_speed[over] != before.target_speed[over])
        assert np.all((state.time_to_target[over] >= 3.0) & (state.time_to_target[over] <= 7.0))


def test_fresh_environments_redraw_and_the_others_do_not():
    generator = np.random.default_rng(10)
    schedule = AdaptiveSchedule(targets=TargetSampling(zero_share=0.0))
    state = advance(schedule, initial_state(10, np.zeros(1)), draw_inputs(generator, 10))
    reset_mask = np.arange(10) % 2 == 0
    after = advance(schedule, state, draw_inputs(generator, 10) | {"reset_mask": reset_mask})
    assert np.all((after.target_speed != state.target_speed) == reset_mask)
    assert np.all((after.command[:, 0] != state.command[:, 0]) == reset_mask)


def test_uniform_command_is_the_target_at_once():
    inputs = draw_inputs(np.random.default_rng(11), 5000)
    state = advance(UniformSchedule(), initial_state(5000, np.zeros(1)), inputs)
    assert np.array_equal(state.command[:, 0], state.target_speed)
    nonzero = state.target_speed[state.target_speed != 0.0]
    assert np.mean(nonzero) == pytest.approx((9.0 - 2.0) / 2, abs=0.15)


@pytest.mark.parametrize(
    ("schedule", "share"),
    [
        (AdaptiveSchedule(targets=TargetSampling(persistence=(60.0, 60.0)), ramp_share=0.4), 0.4),
        (FixedAccelerationSchedule(targets=TargetSampling(persistence=(6.0, 6.0))), 1.0),
    ],
)
def test_ramps_move_the_command_at_their_acceleration_whatever_the_robot_does(schedule, share):
    generator, n = np.random.default_rng(15), 2000
    fresh = {"reset_mask": np.ones(n, dtype=bool), "speed": np.zeros(n)}
    state = advance(schedule, initial_state(n, np.zeros(1)), draw_inputs(generator, n) | fresh)
    ramped = state.acceleration > 0.0
    assert ramped.mean() == pytest.approx(share, abs=0.04)
    assert np.all((state.acceleration >= 2.0) & (state.acceleration <= 4.0) | ~ramped)
    for _ in range(250):
        before, state = state, advance(schedule, state, draw_inputs(generator, n))
        step = np.abs(state.command[:, 0] - before.command[:, 0])[ramped]
        left = np.abs(before.target_speed - before.command[:, 0])[ramped]
        np.testing.assert_allclose(step, np.minimum(left, state.acceleration[ramped] * DT), atol=1e-12)
    np.testing.assert_allclose(state.command[ramped, 0], state.target_speed[ramped], atol=1e-9)


@given(
    yaw_rate=st.floats(-5, 5),
    speed=st.floats(-20, 20),
    friction=st.floats(0.05, 2.0),
)
def test_yaw_rate_never_asks_for_more_than_friction(yaw_rate, speed, friction):
    limited = limit_yaw_rate(np.array([yaw_rate]), np.array([speed]), friction)[0]
    assert abs(limited * speed) <= friction * 9.81 * (1 + 1e-12)
    assert abs(limited) <= abs(yaw_rate) and limited * yaw_rate >= 0.0
    if abs(yaw_rate * speed) <= friction * 9.81 * (1 - 1e-12):
        assert limited == yaw_rate
