"""The training environment: thousands of robots, nothing in a step that waits for the device.

A step is two graph launches on CUDA: the substeps (``BatchSimulation``) and everything after them
(``_after_physics``: rewards, ends, resets, commands, observations). All state lives in fixed buffers, and
resets are masks. On the CPU the same code runs without graphs.
"""

from __future__ import annotations

import math
from typing import Any

import torch
from rsl_rl.env import VecEnv
from tensordict import TensorDict

from sprintlab.commands import CommandState, fastest_speed, initial_state
from sprintlab.control import (
    LowPass,
    Proprioception,
    join_proprioception,
    joint_targets,
    network_input,
    observation_frame,
    split_proprioception,
    update_history,
)
from sprintlab.control.arrays import where_rows
from sprintlab.control.contract import ACTION_LIMIT
from sprintlab.robots import load_robot
from sprintlab.training.kinematics import BodyState, Kinematics, heading_velocity
from sprintlab.training.randomization import randomize
from sprintlab.training.rewards import RewardInput, aggregate, penalties, tracking
from sprintlab.training.settings import TrainingSettings
from sprintlab.training.simulation import BatchSimulation

POLICY_STEP = 0.02
SPEED_AVERAGE = 0.1
"""Weight of the newest speed in the running speed that the command schedule follows."""
_IMPOSSIBLE_JOINT_SPEED = 150.0
_LOGGED = (
    "tracking", "turning", "reward", "speed", "command_error", "falls", "power", "contact", "on_limit",
    "tilt", "broken", "vertical_speed",
)  # fmt: skip


class SprintEnvironment(VecEnv):
    """``n`` robots that chase scheduled commands (an rsl_rl ``VecEnv``).

    Observation groups: ``actor`` ``(n, 45 H)`` with noise and filter, ``critic`` ``(n, 53)``: clean frame,
    body velocity 3, height 1, foot contacts 4.
    """

    def __init__(self, settings: TrainingSettings, device: str = "cuda:0", use_graph: bool = True) -> None:
        torch.manual_seed(settings.seed)
        self.settings, self.device = settings, device
        self.cfg = settings.as_dict()
        self.robot = load_robot(settings.robot)
        self.num_envs, self.num_actions = settings.simulation.environments, len(self.robot.joint_names)
        self.simulation = BatchSimulation(self.robot, settings.simulation, settings.actuator_model, device)
        self.kinematics = Kinematics(self.robot, self.simulation)
        self.friction = randomize(self.simulation, settings.randomization)
        self._filter = LowPass()
        self._allocate_constants()
        self._allocate_state()
        self.set_curriculum(1.0, -1.0, 0.0)
        self._reset_all()
        self._graph = self._capture() if use_graph and str(device).startswith("cuda") else None

    # --- memory ------------------------------------------------------------------------------------------

    def _allocate_constants(self) -> None:
        def tensor(values: Any) -> torch.Tensor:
            return torch.tensor(values, dtype=torch.float32, device=self.device)

        robot, noise = self.robot, self.settings.randomization
        self._default_pose, self._action_scale = tensor(robot.default_pose), tensor(robot.action_scale)
        self._stop_lower = tensor(robot.position_limits[:, 0] + robot.soft_stop.zone)
        self._stop_upper = tensor(robot.position_limits[:, 1] - robot.soft_stop.zone)
        weights = self.settings.rewards.penalties().values()
        self._first_weights = tensor([weight.first for weight in weights])
        self._second_weights = tensor([weight.second for weight in weights])
        amplitudes = (noise.angular_velocity_noise, noise.gravity_noise)
        joints = (noise.joint_position_noise, noise.joint_velocity_noise)
        self._noise = tensor(
            [a for a in amplitudes for _ in range(3)] + [a for a in joints for _ in range(12)]
        )
        self._standing_qpos = tensor(self.simulation.mj_model.key_qpos[0])

    def _allocate_state(self) -> None:
        n, joints = self.num_envs, self.num_actions

        def zeros(*shape: int) -> torch.Tensor:
            return torch.zeros(*shape, device=self.device)

        layout = self.settings.observation
        self.action, self.previous_action, self.earlier_action = (zeros(n, joints) for _ in range(3))
        self.last_joint_velocity, self.running_speed = zeros(n, joints), zeros(n)
        self.filtered = zeros(n, 30)
        self.history = zeros(n, layout.history_length, layout.frame_size)
        self.commands: CommandState = initial_state(n, zeros(1))
        self.episode_length_buf = torch.zeros(n, dtype=torch.long, device=self.device)
        shortest, longest = self.settings.episodes.duration
        lengths = shortest + (longest - shortest) * torch.rand(n, device=self.device)
        self.episode_limit = (lengths / POLICY_STEP).long()
        self.max_episode_length = int(longest / POLICY_STEP)
        self.lower, self.upper, self.stage = (torch.zeros((), device=self.device) for _ in range(3))
        self.weights = self._first_weights.clone()
        self.reward, self.time_out = zeros(n), zeros(n)
        self.done = torch.zeros(n, dtype=torch.long, device=self.device)
        self.actor_observation, self.critic_observation = zeros(n, layout.input_size), zeros(n, 53)
        self._log_sums = zeros(len(_LOGGED) + len(self.weights))
        self._logged_steps = 0

    # --- curriculum --------------------------------------------------------------------------------------

    def set_curriculum(self, upper: float, lower: float, stage: float) -> None:
        """Range of commanded speeds [m/s], and the share of stage II in the reward weights."""
        self.upper.fill_(upper)
        self.lower.fill_(lower)
        self.stage.fill_(stage)
        self.weights.copy_(self._first_weights * (1 - stage) + self._second_weights * stage)

    # --- rsl_rl ------------------------------------------------------------------------------------------

    def get_observations(self) -> TensorDict:
        """The present observations (the environment's own buffers)."""
        groups = {"actor": self.actor_observation, "critic": self.critic_observation}
        return TensorDict(groups, batch_size=[self.num_envs], device=self.device)

    def step(self, actions: torch.Tensor) -> tuple[TensorDict, torch.Tensor, torch.Tensor, dict[str, Any]]:
        """One policy step of 20 ms; rewards are per second times 0.02 s."""
        self.action.copy_(actions.clamp(-ACTION_LIMIT, ACTION_LIMIT))
        target = joint_targets(self.action, self._default_pose, self._action_scale, ACTION_LIMIT)
        self.simulation.target.copy_(target)
        self.simulation.step()
        if self._graph is not None:
            self._graph.replay()
        else:
            self._after_physics()
        self._logged_steps += 1
        return self.get_observations(), self.reward, self.done, {"time_outs": self.time_out}

    # --- the step after physics --------------------------------------------------------------------------

    def _capture(self) -> torch.cuda.CUDAGraph:
        """``_after_physics`` as a graph; warmed up first on a side stream, as PyTorch asks."""
        stream = torch.cuda.Stream()
        stream.wait_stream(torch.cuda.current_stream())
        with torch.cuda.stream(stream):
            for _ in range(3):
                self._after_physics()
        torch.cuda.current_stream().wait_stream(stream)
        torch.cuda.synchronize()
        graph = torch.cuda.CUDAGraph()
        with torch.cuda.graph(graph):
            self._after_physics()
        self._reset_all()
        self._log_sums.zero_()
        return graph

    def _after_physics(self) -> None:
        self.episode_length_buf.add_(1)
        body = self.kinematics.read()
        self.running_speed.add_(SPEED_AVERAGE * (body.velocity[:, 0] - self.running_speed))
        failed = self._failed(body)
        timed_out = (self.episode_length_buf >= self.episode_limit) & ~failed
        self._reward(body, failed)
        self.time_out.copy_(timed_out)
        self.done.copy_(failed | timed_out)
        self.earlier_action.copy_(self.previous_action)
        self.previous_action.copy_(self.action)
        self.last_joint_velocity.copy_(body.joint_velocity)
        self._push()
        fresh = failed | timed_out
        copied = self._reset(fresh)
        self._advance_commands(fresh & ~copied)
        self._observe(fresh & ~copied)

    def _failed(self, body: BodyState) -> torch.Tensor:
        """Fallen, legs through each other, or numbers that no robot has."""
        episodes = self.settings.episodes
        tilt = body.gravity[:, 2] > -math.cos(math.radians(episodes.tilt_limit))
        touching = (body.trunk_clearance < 0.0) | (body.knee_height < episodes.knee_clearance).any(1)
        crossed = (body.leg_distance < episodes.leg_distance_limit).any(1)
        broken = ~torch.isfinite(self.simulation.qvel).all(1) | (
            body.joint_velocity.abs() > _IMPOSSIBLE_JOINT_SPEED
        ).any(1)
        self._log_sums[_LOGGED.index("broken")] += broken.float().mean()
        return tilt | touching | crossed | broken

    def _reward(self, body: BodyState, failed: torch.Tensor) -> None:
        above = (body.joint_position - self._stop_upper).clamp(min=0.0)
        below = (self._stop_lower - body.joint_position).clamp(min=0.0)
        inputs = RewardInput(
            body=body,
            command=self.commands.command,
            action=self.action,
            previous_action=self.previous_action,
            earlier_action=self.earlier_action,
            joint_acceleration=(body.joint_velocity - self.last_joint_velocity) / POLICY_STEP,
            torque=self.simulation.drive_torque,
            limit_excess=above + below,
            base_height_target=self.robot.base_height_target,
        )
        rewards = self.settings.rewards
        follow, turn = tracking(inputs, rewards)
        weighted = penalties(inputs, rewards) * self.weights
        positive = rewards.linear_tracking * follow + rewards.angular_tracking * turn
        rate = torch.nan_to_num(aggregate(positive, weighted.sum(1), rewards))
        self.reward.copy_(torch.where(failed, torch.zeros_like(rate), rate) * POLICY_STEP)
        self._log(body, follow, turn, rate, failed, weighted)

    def _log(
        self,
        body: BodyState,
        follow: torch.Tensor,
        turn: torch.Tensor,
        rate: torch.Tensor,
        failed: torch.Tensor,
        weighted: torch.Tensor,
    ) -> None:
        """Add this step's means to the sums; read once an iteration by ``take_log``."""
        power = (self.simulation.drive_torque * body.joint_velocity).clamp(min=0.0).sum(1)
        forward = body.velocity[:, 0]
        values = {
            "tracking": follow,
            "turning": turn,
            "reward": rate,
            "speed": forward,
            "command_error": (self.commands.command[:, 0] - forward).abs(),
            "falls": failed.float(),
            "power": power,
            "contact": body.contact,
            "on_limit": self.simulation.on_limit,
            "tilt": body.gravity[:, :2].norm(dim=1),
            "vertical_speed": body.velocity[:, 2].abs(),
        }
        for name, value in values.items():
            self._log_sums[_LOGGED.index(name)] += torch.nan_to_num(value).mean()
        self._log_sums[len(_LOGGED) :] += weighted.mean(0)

    def _push(self) -> None:
        """Now and then a kick: a random change of the horizontal base velocity."""
        settings = self.settings.randomization
        draw = torch.rand(self.num_envs, 3, device=self.device)
        kicked = (draw[:, :1] < POLICY_STEP / settings.push_interval).float()
        self.simulation.qvel[:, :2] += kicked * settings.push_speed * (2 * draw[:, 1:] - 1)

    # --- resets ------------------------------------------------------------------------------------------

    def _reset_all(self) -> None:
        """Fresh starts everywhere; no copies, since nobody runs yet."""
        everyone = torch.ones(self.num_envs, dtype=torch.bool, device=self.device)
        self.episode_length_buf.zero_()
        self._reset(everyone)
        self._advance_commands(everyone)
        self._observe(everyone)

    def _reset(self, mask: torch.Tensor) -> torch.Tensor:
        """Restart the environments in ``mask``; returns which of them copied a running one."""
        n = self.num_envs
        draw = torch.rand(n, 4, device=self.device)
        donors = self._donors()
        eligible = ~mask[donors] & (self.episode_length_buf[donors] > 50)
        copied = mask & eligible & (draw[:, 0] < self.settings.episodes.clone_share)
        qpos, qvel = self._fresh_state(draw[:, 1:])
        donor_qpos = self.simulation.qpos[donors]
        donor_qpos[:, :2] = 0.0
        qpos = where_rows(copied, donor_qpos, qpos)
        qvel = where_rows(copied, self.simulation.qvel[donors], qvel)
        restarted = mask & ~copied
        velocity = qvel[:, self.kinematics.joint_qvel]
        self._put(self.simulation.qpos, mask, qpos)
        self._put(self.simulation.qvel, mask, qvel)
        self._put(self.simulation.qacc_warmstart, mask, torch.zeros_like(qvel))
        self._put(self.last_joint_velocity, mask, velocity)
        forward = heading_velocity(qpos[:, 3:7], qvel[:, :3])[:, 0]
        for buffer in (self.previous_action, self.earlier_action):
            self._put(buffer, copied, buffer[donors])
            self._put(buffer, restarted, torch.zeros_like(buffer))
        for buffer in (self.filtered, self.history, self.running_speed, *self.commands):
            self._put(buffer, copied, buffer[donors])
        self._put(self.running_speed, restarted, forward)
        self.episode_length_buf.mul_((~mask).long())
        return copied

    def _donors(self) -> torch.Tensor:
        """For each environment, of two drawn at random the one that runs faster ``(n,)``."""
        pair = torch.randint(0, self.num_envs, (2, self.num_envs), device=self.device)
        faster = self.running_speed[pair[0]] > self.running_speed[pair[1]]
        return torch.where(faster, pair[0], pair[1])

    def _fresh_state(self, draw: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Standing robots with noise in pose and heading, some of them already moving forward."""
        n, simulation = self.num_envs, self.simulation
        yaw = (2 * draw[:, 0] - 1) * math.pi
        qpos = self._standing_qpos.repeat(n, 1)
        qpos[:, 2] += 0.01 + 0.02 * draw[:, 1]
        qpos[:, 3], qpos[:, 6] = torch.cos(yaw / 2), torch.sin(yaw / 2)
        noise = 0.2 * (torch.rand(n, self.num_actions, device=self.device) - 0.5)
        qpos[:, self.kinematics.joint_qpos] += noise
        moving = draw[:, 2] < self.settings.episodes.fast_start_share
        start = torch.rand(n, 2, device=self.device)
        speed = torch.where(moving, start[:, 0] * self.upper, 0.5 * start[:, 1])
        qvel = torch.zeros_like(simulation.qvel)
        qvel[:, 0], qvel[:, 1] = speed * torch.cos(yaw), speed * torch.sin(yaw)
        qvel[:, 3:6] = 0.4 * (torch.rand(n, 3, device=self.device) - 0.5)
        return qpos, qvel

    @staticmethod
    def _put(buffer: torch.Tensor, mask: torch.Tensor, values: torch.Tensor) -> None:
        """Write the masked rows of ``values`` into ``buffer``."""
        buffer.copy_(where_rows(mask, values, buffer))

    # --- commands and observations -----------------------------------------------------------------------

    def _advance_commands(self, fresh: torch.Tensor) -> None:
        advanced = self.settings.schedule.advance(
            self.commands,
            speed=self.running_speed,
            dt=POLICY_STEP,
            lower=self.lower,
            upper=self.upper,
            friction=self.friction,
            fresh=fresh,
            random=torch.rand(self.num_envs, 8, device=self.device),
        )
        for buffer, value in zip(self.commands, advanced, strict=True):
            buffer.copy_(value)

    def _observe(self, fresh: torch.Tensor) -> None:
        """Noise, filter, frame, history for the actor; the clean truth for the critic."""
        body = self.kinematics.read()
        parts = Proprioception(
            body.angular_velocity, body.gravity, body.joint_position - self._default_pose, body.joint_velocity
        )
        clean = torch.nan_to_num(join_proprioception(parts))
        noisy = clean + self._noise * (2 * torch.rand_like(clean) - 1)
        self.filtered.copy_(self._filter.step(self.filtered, noisy, fresh))
        frame = self._frame(self.filtered)
        self.history.copy_(update_history(self.history, frame, fresh))
        self.actor_observation.copy_(network_input(self.history))
        truth = (body.velocity, body.height[:, None], body.contact)
        critic = torch.cat((self._frame(clean), *truth), 1)
        self.critic_observation.copy_(torch.nan_to_num(critic).clamp(-50.0, 50.0))

    def _frame(self, proprioception: torch.Tensor) -> torch.Tensor:
        frame = observation_frame(
            self.settings.observation,
            **split_proprioception(proprioception)._asdict(),
            command=self.commands.command,
            previous_action=self.previous_action,
        )
        return frame.clamp(-50.0, 50.0)

    # --- statistics --------------------------------------------------------------------------------------

    def take_log(self) -> dict[str, float]:
        """Means since the last call, speed percentiles and the weighted penalties; waits for the device."""
        finite = torch.nan_to_num(self.running_speed)
        speeds = torch.stack([fastest_speed(finite, share) for share in (0.5, 0.95, 0.999)])
        means = self._log_sums / max(1, self._logged_steps)
        values = torch.cat((means, speeds)).tolist()
        self._log_sums.zero_()
        self._logged_steps = 0
        penalty_names = [f"penalty/{name}" for name in self.settings.rewards.penalties()]
        names = [*_LOGGED, *penalty_names, "speed_median", "speed_p95", "speed_p999"]
        return dict(zip(names, values, strict=True))
