"""PPO with the estimator: acting, recording and learning, each one graph on a GPU.

Nothing here waits for the device: the learning rate, the column of the rollout and the check for a diverged
update are tensors. ``take_log`` hands over numbers that the runner reads back, once an iteration.
"""

from __future__ import annotations

import itertools
from typing import Any

import torch

from sprintlab.control import ESTIMATE_SIZE, low_pass_coefficient
from sprintlab.control.filters import ESTIMATE_CUTOFF_HZ
from sprintlab.core.errors import SprintlabError
from sprintlab.robots import RobotDescription
from sprintlab.training.environment.sprint import POLICY_STEP, SprintEnvironment
from sprintlab.training.graphs import captured, compiled
from sprintlab.training.learner import annealing
from sprintlab.training.learner.distributed import Workers
from sprintlab.training.learner.losses import (
    EstimatorBatch,
    PolicyBatch,
    adapted_learning_rate,
    estimator_gradients,
    generalized_advantages,
    log_probability,
    loss_scale,
    noise_scale_per_env,
    policy_gradients,
    precision_of,
    robot_noise,
)
from sprintlab.training.learner.metric_buffer import MetricBuffer
from sprintlab.training.learner.networks import LARGEST_STD, LATENT_SIZE, Actor, Critic
from sprintlab.training.learner.parameters import ParameterBlock
from sprintlab.training.learner.storage import Rollout
from sprintlab.training.settings import TrainingSettings

LOSS_NAMES = (
    "surrogate", "value", "entropy", "divergence", "velocity", "contact", "reconstruction", "latent",
)  # fmt: skip
ESTIMATOR_EPOCHS = 1
"""Passes of the estimator over the rollout; one is enough."""


def build_actor(settings: TrainingSettings, robot: RobotDescription) -> Actor:
    """The actor of these settings for a robot, its filter at the policy's rate."""
    coefficient = low_pass_coefficient(ESTIMATE_CUTOFF_HZ, 1.0 / POLICY_STEP)
    return Actor(settings, len(robot.joint_names), robot.base_height_target, coefficient)


class EstimatorPpo:
    """Actor, critic and estimator with their rollout and optimizers, bound to an environment's buffers.

    Args:
        fused: whether kernels are compiled (GPU only); the reference path is the same code, plain.
        workers: further processes with which gradients and statistics are shared.
    """

    def __init__(self, environment: SprintEnvironment, fused: bool, workers: Workers) -> None:
        self.environment, self.settings = environment, environment.settings
        self.device, self._workers = str(environment.device), workers
        fused = fused and self.device.startswith("cuda")
        self._build(environment)
        self._decide, self._store = compiled(self._act_with, fused), compiled(self._record, fused)
        self._advantages = compiled(self._bootstrap, fused)
        self._policy_back = compiled(self._policy_gradient, fused)
        self._policy_on = compiled(self._policy_step, fused)
        self._estimator_back = compiled(self._estimator_gradient, fused)
        self._estimator_on = compiled(self.estimator_block.step, fused)
        self._conclude = compiled(self._finish, fused and not workers.several)
        self.act, self.record, self.update = self._act, self._store, self._update
        self._capture()

    def _build(self, environment: SprintEnvironment) -> None:
        settings, ppo = self.settings, self.settings.ppo
        self.actor = build_actor(settings, environment.robot).to(self.device)
        self.critic = Critic(ppo, environment.observation).to(self.device)
        self._workers.broadcast([*self.actor.parameters(), *self.critic.parameters()])
        robots, device = environment.num_envs, self.device
        self.rollout = Rollout(robots, ppo.steps, environment.observation, settings, device)
        self._noise_scale = noise_scale_per_env(robots, ppo).unsqueeze(1).to(device)
        self._precision = precision_of(ppo)
        actor, critic, estimator = self.actor, self.critic.value, self.actor.estimator
        self.learning_rate = torch.tensor(ppo.learning_rate, device=device)
        groups = [[*actor.policy.mixed_parameters(), (actor.std, None)], critic.mixed_parameters()]
        self.block = ParameterBlock(groups, self.learning_rate)
        self.estimator_rate = torch.tensor(annealing.ESTIMATOR_RATE, device=device)
        groups = [[*estimator.encoder.mixed_parameters(), *estimator.decoder.mixed_parameters()]]
        self.estimator_block = ParameterBlock(groups, self.estimator_rate)
        for layer in (*actor.policy.stack, *critic.stack):
            layer.rounded = self.block.part(self.block.rounded, layer.weight)
        self._std_place = self.block.place(actor.std)
        self.old_std = self.actor.std.detach().clone()
        self.least_std, self.most_std = (torch.tensor(annealing.LEAST_STD, device=device) for _ in range(2))
        self.desired_kl = torch.tensor(annealing.DESIRED_KL, device=device)
        self.set_phase(0.0)
        self._loss_sums = torch.zeros(len(LOSS_NAMES), device=device)
        self._parts = torch.zeros(4, device=device)
        self.rolled_back = torch.zeros((), device=device)
        self._before = [tensor.detach().clone() for tensor in self._revertible()]

    def set_phase(self, share: float) -> None:
        """Action noise, aimed-at divergence and the estimator's learning rate after a share of the run."""
        annealed = annealing.annealed(share)
        self.least_std.fill_(annealed.least_std)
        self.most_std.fill_(min(annealed.most_std, LARGEST_STD))
        self.desired_kl.fill_(annealed.desired_kl)
        self.estimator_rate.fill_(annealed.estimator_rate)
        steady = self.settings.stages.is_steady(share)
        self.rollout.noise_scale.copy_(self._noise_scale if steady else torch.ones_like(self._noise_scale))

    # --- graphs ------------------------------------------------------------------------------------------

    def _capture(self) -> None:
        """Bind ``act``, ``record`` and ``update`` to graphs, and undo what the warm-up did."""
        if not self.device.startswith("cuda"):
            return
        touched = [*self._revertible(), self.learning_rate]
        kept = [tensor.clone() for tensor in touched]
        self.act = captured(self._act, self.device)
        self.record = captured(self._store, self.device)
        self.update = captured(self._update, self.device)
        with torch.no_grad():
            for tensor, value in zip(touched, kept, strict=True):
                tensor.copy_(value)
        self.block.refresh()
        for tensor in (self._loss_sums, self.rolled_back, self.rollout.step, self.environment.estimate):
            tensor.zero_()

    def release_graphs(self) -> None:
        """Let go of the graphs; nothing can be learned afterwards.

        NCCL waits for the graphs that hold its operations before it gives up a connection: a process that
        left the others with an update's graph at hand would never end.
        """
        del self.act, self.record, self.update

    def _moments(self) -> list[torch.Tensor]:
        """Both optimizers' state, in a fixed order."""
        return [*self.block.state(), *self.estimator_block.state()]

    def _revertible(self) -> list[torch.Tensor]:
        """What a diverged update would spoil; the blocks hold every parameter."""
        moments = [each for network in (self.actor, self.critic) for each in network.normalizer.moments()]
        return [self.block.values, self.estimator_block.values, *moments, *self._moments()]

    # --- acting ------------------------------------------------------------------------------------------

    @torch.no_grad()
    def _act(self) -> None:
        """Perceive, decide, add noise; hand the action to the environment and all of it to the rollout."""
        self._decide(torch.randn_like(self.environment.action))

    @torch.no_grad()
    def _act_with(self, noise: torch.Tensor) -> None:
        environment, rollout = self.environment, self.rollout
        history, privileged = environment.actor_observation, self._privileged()
        actor_input, estimate = self.actor.perceive(history, environment.estimate, environment.handedness)
        environment.estimate.copy_(estimate)
        mean = self.actor.decide(actor_input, self._precision)
        std = robot_noise(self.actor.std, rollout.noise_scale[:, 0])
        action = mean + std * noise
        values = {
            "history": history,
            "actor_input": actor_input,
            "privileged": privileged,
            "action": action,
            "mean": mean,
            "log_probability": log_probability(action, mean, std),
            "value": self.critic(privileged, self._precision),
        }
        for name, each in values.items():
            rollout.write(name, each)
        environment.write_action(action)

    def _privileged(self) -> torch.Tensor:
        """What the critic sees ``(n, 54)``; without handedness ``(n, 53)`` where it is not symmetric."""
        observed = self.environment.critic_observation
        return torch.cat((observed, self.environment.handedness), 1) if self.actor.symmetric else observed

    @torch.no_grad()
    def _record(self) -> None:
        """Store what the step brought, and move on to the next column."""
        environment, rollout = self.environment, self.rollout
        rollout.write("reward", environment.reward)
        rollout.write("end", torch.maximum(environment.done.float(), environment.ended_share))
        rollout.write("time_out", environment.time_out)
        rollout.write("next_frame", environment.actor_observation[:, -rollout.frame_size :])
        rollout.step.add_(1).remainder_(rollout.steps)

    # --- learning ----------------------------------------------------------------------------------------

    def _update(self) -> None:
        """All epochs over the rollout that has just been filled."""
        with torch.no_grad():
            for saved, tensor in zip(self._before, self._revertible(), strict=True):
                saved.copy_(tensor)
        self._prepare()
        blocks = self._blocks()
        for epoch in range(self.settings.ppo.epochs):
            for first, last in blocks:
                self._improve_policy(first, last)
                if epoch < ESTIMATOR_EPOCHS:
                    self._improve_estimator(first, last)
        self._conclude()

    def _blocks(self) -> list[tuple[int, int]]:
        """Mini-batches as blocks of robots; fewer where there are fewer robots."""
        robots, parts = self.rollout.robots, self.settings.ppo.mini_batches
        edges = [robots * part // parts for part in range(parts + 1)]
        return [(first, last) for first, last in itertools.pairwise(edges) if first < last]

    @torch.no_grad()
    def _prepare(self) -> None:
        """Advantages and returns of the rollout."""
        self._advantages()
        self.rollout.advantage.copy_(self._workers.normalized(self.rollout.advantage))

    @torch.no_grad()
    def _bootstrap(self) -> None:
        """Advantages, not normalized, and returns, from the value of the states after the last step."""
        r = self.rollout
        self.old_std.copy_(self.actor.std)
        last = self.critic(self._privileged())
        advantage = generalized_advantages(r.reward, r.value, r.end, r.time_out, last, self.settings.ppo)
        r.returns.copy_(advantage + r.value)
        r.advantage.copy_(advantage)

    def _improve_policy(self, first: int, last: int) -> None:
        self._policy_back(self.rollout.policy_batch(first, last))
        self._workers.average(self._parts)
        self._workers.average(self.block.gradient)
        self._policy_on()

    @torch.no_grad()
    def _policy_gradient(self, batch: PolicyBatch) -> None:
        gradients, parts = policy_gradients(self.actor, self.critic, batch, self.old_std, self.settings.ppo)
        self.block.write(gradients, loss_scale(len(batch.action)))
        self._parts.copy_(parts)

    @torch.no_grad()
    def _policy_step(self) -> None:
        """Adapt the learning rate to the divergence, take the step, and add the losses to the sums."""
        ppo = self.settings.ppo
        self.learning_rate.copy_(adapted_learning_rate(self.learning_rate, self._parts[3], self.desired_kl))
        self._loss_sums[:4] += self._parts / (ppo.epochs * ppo.mini_batches)
        self.block.step()
        std = self.block.values[self._std_place]
        std.copy_(std.clamp(self.least_std, self.most_std))

    def _improve_estimator(self, first: int, last: int) -> None:
        samples = (last - first) * self.rollout.steps
        noise = torch.randn(samples, LATENT_SIZE, device=self.device)
        self._estimator_back(self.rollout.estimator_batch(first, last, noise))
        self._workers.average(self.estimator_block.gradient)
        self._estimator_on()

    @torch.no_grad()
    def _estimator_gradient(self, batch: EstimatorBatch) -> None:
        gradients, parts = estimator_gradients(self.actor, batch)
        self.estimator_block.write(gradients)
        self._loss_sums[4:] += parts / (ESTIMATOR_EPOCHS * self.settings.ppo.mini_batches)

    @torch.no_grad()
    def _finish(self) -> None:
        self._update_normalizers()
        self._roll_back_if_diverged()

    def _update_normalizers(self) -> None:
        """After the update, so that its likelihood ratios compare the policies on equal inputs."""
        known = self.rollout.frame_size + ESTIMATE_SIZE
        pairs = (
            (self.actor.normalizer, self.rollout.actor_input[..., :known]),
            (self.critic.normalizer, self.rollout.privileged[..., :known]),
        )
        for normalizer, values in pairs:
            mean, variance = self._workers.moments(values.mean((0, 1)), values.var((0, 1), correction=0))
            normalizer.update(mean, variance, values.shape[0] * values.shape[1] * self._workers.count)

    def _roll_back_if_diverged(self) -> None:
        """A NaN anywhere: networks and optimizers as before the update, and a fresh, slower start."""
        tensors = self._revertible()
        finite = torch.stack([tensor.isfinite().all() for tensor in tensors]).all()
        for saved, tensor in zip(self._before, tensors, strict=True):
            tensor.copy_(torch.where(finite, tensor, saved))
        self.block.refresh()
        self.learning_rate.copy_(torch.where(finite, self.learning_rate, 0.5 * self.learning_rate))
        self.learning_rate.nan_to_num_(nan=1e-4)
        self.rolled_back.add_(1.0 - finite.float())

    # --- numbers, checkpoints ----------------------------------------------------------------------------

    def take_log(self) -> MetricBuffer:
        """Losses since the last call, learning rate, noise, updates rolled back."""
        extra = torch.stack((self.learning_rate, self.actor.std.detach().mean(), self.rolled_back))
        values = torch.cat((self._loss_sums, extra))
        self._loss_sums.zero_()
        names = [f"loss/{name}" for name in LOSS_NAMES]
        return MetricBuffer([*names, "learning_rate", "action_std", "rolled_back"], values)

    def state_dict(self) -> dict[str, Any]:
        """Networks, normalizers, estimator, optimizers, learning rate."""
        return {
            "actor": self.actor.state_dict(),
            "critic": self.critic.state_dict(),
            "moments": self._moments(),
            "learning_rate": self.learning_rate,
            "rolled_back": self.rolled_back,
        }

    @torch.no_grad()
    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Take up a run; values are copied into the tensors of the graphs. Raises ``SprintlabError``."""
        moments = self._moments()
        if [value.shape for value in state["moments"]] != [value.shape for value in moments]:
            raise SprintlabError(
                "the optimizer of this checkpoint does not fit (other widths of the networks, or an earlier "
                "version of sprintlab): it can be exported, but not trained further"
            )
        self.actor.load_state_dict(state["actor"])
        self.critic.load_state_dict(state["critic"])
        for tensor, value in zip(moments, state["moments"], strict=True):
            tensor.copy_(value)
        self.learning_rate.copy_(state["learning_rate"])
        self.rolled_back.copy_(state["rolled_back"])
        self.block.refresh()
