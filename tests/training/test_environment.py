"""Resets, ends, randomization and observations of a small batch on the CPU."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from tests.training.small import copy_tensors, tensors

from sprintlab.commands import heading_angle
from sprintlab.control.standing import StandingContract, StandingHold
from sprintlab.engine import Engine, EngineOptions
from sprintlab.robots import load_robot
from sprintlab.training.environment.episodes import Ends, find_ends, standing_starts
from sprintlab.training.environment.fleet import Fleet
from sprintlab.training.environment.randomization import default_randomization, friction, slope, strength
from sprintlab.training.environment.sprint import SUBSTEPS, SprintEnvironment
from sprintlab.training.settings import (
    UNDISTURBED,
    EpisodeSettings,
    SimulationSettings,
    TrainingSettings,
)
from sprintlab.training.terms import drawn

N = 16
SIMULATION = SimulationSettings(environments=N)
ROBOT = load_robot("bp2")


@pytest.fixture(scope="module")
def built() -> SprintEnvironment:
    settings = TrainingSettings(
        simulation=SIMULATION,
        episodes=EpisodeSettings(clone_share=0.5, fast_start_share=0.5),
    )
    return SprintEnvironment(settings.nominal(), "cpu")


@pytest.fixture
def environment(built: SprintEnvironment) -> SprintEnvironment:
    """All robots at the start of an episode, one step in; none has ended."""
    torch.manual_seed(3)
    built.set_curriculum(1.0, -1.0, 0.0)
    built.engine.qpos.nan_to_num_()
    built._start_all()
    built.step(torch.zeros(N, 12))
    assert not built.done.any()
    return built


def test_a_masked_reset_is_a_loop_over_rows(environment: SprintEnvironment) -> None:
    simulation = environment.engine
    mask = torch.arange(N) % 2 == 0
    environment.episode_length_buf.copy_(torch.arange(N) * 10)
    environment.running_speed.copy_(torch.linspace(0.0, 5.0, N))
    environment.previous_action.copy_(torch.randn(N, 12))
    environment.estimate.copy_(torch.randn(N, 8))
    environment.draws.refill()
    watched = (simulation.qpos, simulation.qvel, environment.previous_action, environment.estimate)
    old = [values.clone() for values in watched]
    lengths = environment.episode_length_buf.clone()
    e, speeds = environment, simulation.qvel.shape[1]
    place = e._standing_qpos, e.kinematics.joint_qpos, speeds, e.upper, e.draws, e.settings.episodes
    fresh = [*standing_starts(*place), torch.zeros(N, 12), torch.zeros(N, 8)]
    expected, copies = [values.clone() for values in old], []
    for row in torch.nonzero(mask)[:, 0].tolist():
        one, other = (environment.draws["donor"][row] * N).long().tolist()
        donor = one if environment.running_speed[one] > environment.running_speed[other] else other
        chance = float(environment.draws["clone"][row, 0])
        copies.append(bool(not mask[donor] and lengths[donor] > 50 and chance < 0.5))
        for result, before, new in zip(expected, old, fresh, strict=True):
            result[row] = before[donor] if copies[-1] else new[row]
        if copies[-1]:
            expected[0][row, :2] = 0.0
    restarted = environment._restart(mask)
    assert (~restarted[mask]).tolist() == copies
    assert any(copies) and not all(copies)
    for values, wanted in zip(watched, expected, strict=True):
        torch.testing.assert_close(values, wanted)
    assert torch.equal(environment.episode_length_buf, torch.where(mask, 0, lengths))


def test_a_fallen_robot_ends_without_reward_and_starts_again(environment: SprintEnvironment) -> None:
    environment.engine.qpos[2, 3:7] = torch.tensor([0.0, 1.0, 0.0, 0.0])
    _, reward, done, extras = environment.step(torch.zeros(N, 12))
    assert torch.nonzero(done)[:, 0].tolist() == torch.nonzero(reward == 0.0)[:, 0].tolist() == [2]
    assert not extras["time_outs"].any() and environment.episode_length_buf[2] == 0
    assert environment.kinematics.read().gravity[2, 2] < -0.99
    assert not environment.step(torch.zeros(N, 12))[2].any()


def test_nan_ends_only_its_own_environment(environment: SprintEnvironment) -> None:
    environment.engine.qpos[5, 9] = float("nan")
    for ended in ([5], [], []):
        observations, reward, done, _ = environment.step(torch.zeros(N, 12))
        assert torch.nonzero(done)[:, 0].tolist() == torch.nonzero(reward == 0.0)[:, 0].tolist() == ended
        for values in (observations["actor"], observations["critic"], reward, environment.engine.qpos):
            assert torch.isfinite(values).all()


def test_an_episode_ends_at_its_limit_as_a_time_out(environment: SprintEnvironment) -> None:
    environment.episode_length_buf[7] = environment.episode_limit[7] - 1
    _, reward, done, extras = environment.step(torch.zeros(N, 12))
    assert torch.nonzero(done)[:, 0].tolist() == torch.nonzero(extras["time_outs"])[:, 0].tolist() == [7]
    assert reward[7] > 0.0


def test_legs_too_close_end_an_episode(environment: SprintEnvironment) -> None:
    e, body = environment, environment.kinematics.read()
    distance = body.leg_distance.clone()
    distance[3, 1], distance[4, 1] = -0.001, 0.001
    body, lengths = body._replace(leg_distance=distance), (e.episode_length_buf, e.episode_limit)
    ends = find_ends(body, e.engine.qvel, *lengths, e._knee_clearance)
    assert torch.nonzero(ends.failed)[:, 0].tolist() == [3]


def test_a_held_target_opens_the_grid_around_it(environment: SprintEnvironment) -> None:
    grid = environment.grid
    assert grid is not None
    before = environment.grid_weights.clone()
    environment.commands.time_to_target.fill_(1.0)
    environment.commands.time_to_target[4:6] = 0.01
    environment.commands.target_speed[4:6] = 3.1
    environment.commands.command[:, 2] = 0.0
    environment.running_yaw_rate.zero_()
    environment.running_speed.fill_(3.2)
    environment.running_speed[5] = 0.0
    environment._learn_grid(Ends(*(torch.zeros(N, dtype=torch.bool) for _ in range(3))))
    gained = environment.grid_weights - before
    row, column = (int(values) for values in grid.bins(torch.tensor(3.1), torch.tensor(0.0)))
    assert gained[row, column] == pytest.approx(2 * grid.gain)
    assert gained[row + 1, column - 1] == pytest.approx(grid.gain)
    assert torch.count_nonzero(gained) == 9


def test_command_and_speed_are_averaged_alike(environment: SprintEnvironment) -> None:
    """Robots that stay 1 m/s above a changing command are paid for an error of 1 m/s."""
    environment.running_command[:, 0] = environment.running_speed - 1.0
    speeds = []

    def ask() -> None:
        speed = environment.kinematics.read().velocity[:, 0]
        environment.commands.command[:, 0] = speed - 1.0
        speeds.append(speed.clone())

    for _ in range(5):
        environment.advance(between=ask)
        assert not environment.done.any()
        error = environment.running_speed - environment.running_command[:, 0]
        torch.testing.assert_close(error, torch.ones(N), atol=1e-5, rtol=0.0)
    assert (speeds[-1] - speeds[0]).abs().max() > 0.01


def test_state_is_all_that_a_step_needs(environment: SprintEnvironment) -> None:
    saved = {name: value.clone() for name, value in tensors(environment).items()}
    action = 0.1 * torch.randn(N, 12)
    runs = []
    for _ in range(2):
        copy_tensors(saved, environment)
        torch.manual_seed(12)
        for _ in range(3):
            environment.step(action)
        runs.append({name: value.clone() for name, value in tensors(environment).items()})
    for name, value in runs[0].items():
        assert torch.equal(value, runs[1][name]), name


def test_the_delay_varies_from_step_to_step_and_stays_within_a_step() -> None:
    settings = TrainingSettings(simulation=SIMULATION)
    environment, seen = SprintEnvironment(settings, "cpu"), []
    for _ in range(6):
        environment.step(torch.zeros(N, 12))
        seen.append(environment.engine.delay.clone())
    delays = torch.stack(seen)
    assert (delays.float().std(0) > 0).any() and ((delays >= 0) & (delays <= SUBSTEPS)).all()


FIELDS = (
    "friction", "pad_stiffness", "pad_damping", "drag_area", "trunk_mass", "weight", "trunk_center",
    "stiffness", "damping", "strength", "voltage", "resistance_factor", "friction_factor", "timestep",
)  # fmt: skip


def test_randomization_varies_each_field(built: SprintEnvironment) -> None:
    varied = SprintEnvironment(TrainingSettings(simulation=SIMULATION), "cpu")
    for name in FIELDS:
        assert (getattr(varied.engine, name).std(0) > 0).all(), name
        same = getattr(built.engine, name)
        assert torch.equal(same, same[:1].expand_as(same)), name


def test_motors_are_strong_or_weak_together() -> None:
    engine = Engine(ROBOT, EngineOptions(robots=64), "cpu")
    Fleet(engine, {"strength": drawn(strength, between=(0.9, 1.03), joints=0.02)})
    mean = engine.strength.mean(1, keepdim=True)
    assert mean.min() < 0.92 and mean.max() > 1.0
    assert 0.01 < (engine.strength / mean - 1.0).abs().max() < 0.05


def test_one_draw_is_repeatable() -> None:
    terms = {**default_randomization(), "friction": drawn(friction, between=(0.7, 0.8))}
    parameters = []
    for _ in range(2):
        torch.manual_seed(2)
        engine = Engine(ROBOT, EngineOptions(robots=N), "cpu")
        Fleet(engine, terms)
        parameters.append(engine.parameters.clone())
    assert torch.equal(*parameters)
    assert ((engine.friction >= 0.7) & (engine.friction <= 0.8)).all()


def test_a_slope_turns_gravity_for_the_physics_and_for_what_the_policy_sees() -> None:
    settings = TrainingSettings(
        simulation=SimulationSettings(environments=4),
        randomization={"slope": drawn(slope, between=(-0.1, 0.1))},
        disturbances=UNDISTURBED,
    )
    environment = SprintEnvironment(settings, "cpu")
    simulation, rise = environment.engine, environment.slope
    assert len(set(rise.tolist())) == 4
    assert 0.01 < rise.tan().abs().max() <= 0.1
    simulation.qpos.copy_(environment._standing_qpos.expand_as(simulation.qpos))
    simulation.qpos[:, 2] += 1.0
    simulation.qvel.zero_()
    down = torch.stack((-rise.sin(), torch.zeros(4), -rise.cos()), 1)
    body = environment.kinematics.read()
    torch.testing.assert_close(body.gravity, down)
    half_height = environment.robot.mechanics.trunk_half_size[2]
    torch.testing.assert_close(body.trunk_clearance, body.height - half_height)
    simulation.step()
    torch.testing.assert_close(simulation.qvel[:, 0] / 0.02, -9.81 * rise.sin(), atol=0.01, rtol=0.01)


def test_the_heading_is_held_while_no_turn_is_wanted(environment: SprintEnvironment) -> None:
    environment._start_all()
    environment.commands.time_to_target.fill_(3.0)
    environment.commands.target_yaw_rate.zero_()
    environment.commands.target_yaw_rate[1] = 0.3
    environment.commands.command[:, 0] = environment.running_speed.fill_(2.0)
    environment.commands.target_speed.fill_(2.0)
    environment.commands.time_to_update.fill_(1.0)
    environment.commands.command[3, 0] = 0.0
    environment.commands.acceleration.zero_()
    environment.course.copy_(heading_angle(environment.engine.qpos[:, 3:7]) + 0.1)
    course = environment.course.clone()
    environment._advance_commands(torch.arange(N) == 2)
    yaw_rate = environment.commands.command[:, 2]
    assert yaw_rate[0] == pytest.approx(0.4, abs=1e-3)  # gain 4 1/s, 0.1 rad to go
    assert yaw_rate[1] == pytest.approx(0.3)
    assert environment.commands.command[3].abs().max() == 0.0, "it is asked to stand, and nothing else"
    assert environment.course[2] == pytest.approx(float(course[2]) - 0.1, abs=1e-5)
    assert torch.equal(environment.course[3:], course[3:])


def hold_once(environment: SprintEnvironment, estimated: float, fresh: bool = False) -> torch.Tensor:
    """All robots are asked to stand, at an estimated speed; returns which are released."""
    environment.commands.command.zero_()
    environment.commands.target_speed.zero_()
    environment.estimate.zero_()
    environment.estimate[:, 0] = estimated
    gravity = environment.kinematics.read().gravity
    return environment._hold(torch.full((N,), fresh), gravity)


def test_a_robot_that_stands_as_asked_is_held_as_the_runtime_holds_it(environment: SprintEnvironment) -> None:
    environment.held.zero_()
    hold = StandingHold(StandingContract(), rate_hz=50.0)
    rest, moving, upright = (np.array(values) for values in ([0.0] * 3, [2.0, 0.0, 0.0], [0.0, 0.0, -1.0]))
    hold.share(moving, rest, upright)
    for _ in range(40):
        assert not hold_once(environment, 0.5).any()
        share = hold.share(rest, np.array([0.5, 0.0, 0.0]), upright)
        assert (1.0 - environment.held).tolist() == pytest.approx([share] * N, abs=1e-6)
    environment.write_action(torch.ones(N, 12))
    assert environment.action.amax().item() == pytest.approx(share, abs=1e-6)


def test_a_released_robot_begins_as_after_a_reset(environment: SprintEnvironment) -> None:
    environment.held.zero_()
    hold_once(environment, 0.5)
    environment.previous_action.fill_(1.0)
    environment.commands.command[: N // 2, 0] = 1.0
    gravity = environment.kinematics.read().gravity
    released = environment._hold(torch.zeros(N, dtype=torch.bool), gravity)
    assert released.tolist() == [True] * (N // 2) + [False] * (N // 2)
    for buffer in (environment.previous_action, environment.estimate):
        assert not buffer[released].any() and buffer[~released].any()


def test_robots_that_run_or_have_no_estimate_are_not_held(environment: SprintEnvironment) -> None:
    for estimated in (2.0, 0.0):
        environment.held.zero_()
        hold_once(environment, estimated)
        assert not environment.held.any()
    environment.running_speed.copy_(torch.where(torch.arange(N) < 4, 5.0, 0.1))
    hold_once(environment, 0.0, fresh=True)
    held = [0.0] * 4 + [1.0] * (N - 4)
    assert environment.held.tolist() == held, "a new episode stands, unless it starts fast"


def test_handedness_is_drawn_per_episode_and_a_copy_takes_over_its_donors() -> None:
    environment = SprintEnvironment(TrainingSettings(simulation=SimulationSettings(environments=64)), "cpu")
    assert set(environment.handedness[:, 0].tolist()) == {-1.0, 1.0}
    before = environment.handedness.clone()
    environment.step(torch.zeros(64, 12))
    assert torch.equal(environment.handedness[environment.done == 0], before[environment.done == 0])


def test_new_targets_keep_within_a_robots_own_record_once_the_range_is_open(
    environment: SprintEnvironment,
) -> None:
    environment.set_curriculum(12.0, -2.0, 1.0, steady=True)
    environment.record.fill_(4.5)
    environment.running_speed.zero_()
    target, renewed = torch.full((N,), 10.0), torch.arange(N) % 2 == 0
    found = environment._within_record(target, renewed)
    assert found[0].item() == pytest.approx(10.0 * (4.5 + 1.5) / 12.0, rel=1e-3)
    assert found[1].item() == 10.0
    environment.set_curriculum(12.0, -2.0, 1.0, steady=False)
    assert torch.equal(environment._within_record(target, renewed), target)
