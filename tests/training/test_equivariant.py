"""A mirrored observation gives the mirrored action: in the layers, the networks and the exported file."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch

from sprintlab.control import ESTIMATE_SIZE
from sprintlab.core.errors import InvalidValueError
from sprintlab.robots import load_robot
from sprintlab.training.learner.algorithm import build_actor
from sprintlab.training.learner.mirror import (
    ESTIMATE_MIRROR,
    HANDEDNESS_MIRROR,
    Basis,
    Mirror,
    frame_mirror,
    joint_mirror,
    paired,
    signed,
)
from sprintlab.training.learner.networks import Actor, Critic, Normalizer
from sprintlab.training.learner.perceptron import Perceptron
from sprintlab.training.runs.export import _onnx_bytes
from sprintlab.training.settings import EstimatorSettings, PpoSettings, TrainingSettings

SETTINGS = TrainingSettings(ppo=PpoSettings(hidden=(64, 32)), estimator=EstimatorSettings(encoder=(32, 16)))
BATCH = 64


def trained_looking_actor(robot: str) -> Actor:
    """Networks and normalization as random as they come, but symmetric statistics."""
    torch.manual_seed(2)
    actor = build_actor(SETTINGS, load_robot(robot))
    size = actor.normalizer.mean.numel()
    actor.normalizer.update(torch.randn(size), torch.rand(size) + 0.5, 1000)
    return actor.eval()


@pytest.mark.parametrize("robot", ["bp2", "bp2-waist"])
def test_actor_and_estimator_are_equivariant(robot: str) -> None:
    actor = trained_looking_actor(robot)
    joints = len(actor.std)
    frame = frame_mirror(SETTINGS.observation.for_joints(joints))
    past = Mirror((), ()).joined(*[frame] * actor.history_length)
    history, previous = torch.randn(BATCH, past.size), torch.randn(BATCH, ESTIMATE_SIZE)
    hand = torch.where(torch.rand(BATCH, 1) < 0.5, 1.0, -1.0)
    with torch.no_grad():
        seen, estimate = actor.perceive(history, previous, hand)
        other, mirrored = actor.perceive(past.of(history), ESTIMATE_MIRROR.of(previous), -hand)
        action, opposite = actor.decide(seen), actor.decide(other)
    torch.testing.assert_close(mirrored, ESTIMATE_MIRROR.of(estimate), atol=1e-5, rtol=0)
    torch.testing.assert_close(opposite, joint_mirror(joints).of(action), atol=1e-5, rtol=0)
    assert (action - joint_mirror(joints).of(action)).abs().max() > 0.01


def test_the_critic_values_mirror_images_alike() -> None:
    observation = SETTINGS.observation.for_joints(12)
    critic = Critic(SETTINGS.ppo, observation)
    mirror = frame_mirror(observation).joined(ESTIMATE_MIRROR, HANDEDNESS_MIRROR)
    state = torch.randn(BATCH, mirror.size)
    with torch.no_grad():
        torch.testing.assert_close(critic(state), critic(mirror.of(state)), atol=1e-5, rtol=0)
        assert critic(state).std() > 1e-3


def test_handedness_breaks_the_tie_of_a_symmetric_state() -> None:
    actor = trained_looking_actor("bp2")
    nothing = torch.zeros(1, actor.history_length * actor.frame_size)
    actor.normalizer.mean.zero_()
    with torch.no_grad():
        action, _ = actor(nothing, torch.zeros(1, ESTIMATE_SIZE))
    assert (action - joint_mirror(12).of(action)).abs().max() > 0.01


def test_the_exported_network_is_the_actor_of_handedness_one(tmp_path: Path) -> None:
    import onnxruntime

    actor = trained_looking_actor("bp2")
    path = tmp_path / "network.onnx"
    path.write_bytes(_onnx_bytes(actor, actor.history_length * actor.frame_size))
    session = onnxruntime.InferenceSession(str(path))
    history = np.random.default_rng(0).normal(size=(3, actor.history_length * actor.frame_size)).astype("f4")
    previous = np.zeros((3, ESTIMATE_SIZE), "f4")
    action, estimate = session.run(None, {"observation": history, "previous_estimate": previous})
    with torch.no_grad():
        seen, wanted = actor.perceive(torch.from_numpy(history), torch.from_numpy(previous), torch.ones(3, 1))
        torch.testing.assert_close(torch.from_numpy(action), actor.decide(seen), atol=1e-5, rtol=0)
    torch.testing.assert_close(torch.from_numpy(estimate), wanted, atol=1e-5, rtol=0)


def test_a_layer_can_be_any_symmetric_map() -> None:
    """Gradient descent brings a random network onto a target that is symmetric, and not onto another."""
    torch.manual_seed(0)
    inward, outward = signed(1.0, -1.0), paired(2)
    network = Perceptron(Basis(2, inward), (32, 16), Basis(2, outward))
    points = 2 * torch.rand(256, 2) - 1
    wanted = torch.stack((points[:, 0] + points[:, 1], points[:, 0] - points[:, 1]), 1)
    optimizer = torch.optim.Adam(network.parameters(), lr=1e-2)
    for _ in range(300):
        loss = (network(points) - wanted).square().mean()
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
    assert loss.item() < 1e-3


def test_the_normalizer_sees_every_sample_and_its_mirror_image() -> None:
    mirror = paired(4).joined(signed(-1.0))
    batches = [torch.randn(size, 5) * 2.0 + 1.0 for size in (10, 500, 33)]
    normalizer = Normalizer(5, mirror)
    for samples in batches:
        normalizer.update(samples.mean(0), samples.var(0, correction=0), len(samples))
    both = torch.cat([*batches, *map(mirror.of, batches)])
    torch.testing.assert_close(normalizer.mean, both.mean(0))
    torch.testing.assert_close(normalizer.variance, both.var(0, correction=0))


@pytest.mark.parametrize("joints", [12, 13])
def test_mirroring_twice_changes_nothing(joints: int) -> None:
    frame = frame_mirror(SETTINGS.observation.for_joints(joints))
    vector = torch.randn(3, frame.size)
    assert torch.equal(frame.of(frame.of(vector)), vector)
    default = torch.tensor(load_robot("bp2" if joints == 12 else "bp2-waist").default_pose)
    torch.testing.assert_close(joint_mirror(joints).of(default), default)


def test_an_odd_width_is_refused() -> None:
    with pytest.raises(InvalidValueError, match="an even number"):
        Perceptron(Basis(1, signed(1.0)), (5,), Basis(1, signed(1.0)))


@pytest.mark.parametrize("mirrored", [True, False])
def test_a_basis_is_orthogonal_and_the_mirror_diagonal_in_it(mirrored: bool) -> None:
    mirror = joint_mirror(13).joined(signed(1.0, -1.0, -1.0))
    basis, vector = Basis(mirror.size, mirror if mirrored else None), torch.randn(5, mirror.size)
    halves = basis(vector)
    torch.testing.assert_close(basis.inverse(halves.unbind()), vector)
    torch.testing.assert_close(halves.square().sum((0, 2)), vector.square().sum(1))
    if mirrored:
        assert torch.equal(basis(mirror.of(vector)), torch.stack((halves[0], -halves[1])))
