"""The training environment: thousands of robots, nothing in a step that waits for the device.

A step is two launches on CUDA: the engine's kernel, which is the whole physics of a policy step, and a graph
of all that follows (rewards, ends, resets, commands, observations), whose kernels ``torch.compile`` fuses.
All state lives in fixed buffers, and resets are masks. With ``fused=False``, and on the CPU, the same code
runs plainly, without graphs and compilation: the reference.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import torch

from sprintlab.commands import (
    CommandState,
    CommandStep,
    TargetOutcome,
    heading_angle,
    heading_command,
    initial_state,
    ranked_speeds,
)
from sprintlab.control import (
    ESTIMATE_SIZE,
    POLICY_RATE_HZ,
    LowPass,
    Measurement,
    join_proprioception,
    joint_targets,
    network_input,
    observation_frame,
    split_proprioception,
    update_history,
)
from sprintlab.control.arrays import where_rows
from sprintlab.control.contract import ACTION_LIMIT
from sprintlab.control.standing import StandingContract, standing_share
from sprintlab.engine import Engine, EngineOptions
from sprintlab.motors import no_load_speed
from sprintlab.robots import load_robot
from sprintlab.training.environment.constraints import (
    FAST_SHARE,
    WATCHED,
    Monitors,
    apparent_weight,
    broken_parts,
    by_phase,
    command_phases,
    ended_share,
    nominal_deflection,
)
from sprintlab.training.environment.draws import Draws
from sprintlab.training.environment.episodes import Ends, choose_starts, find_ends, standing_starts
from sprintlab.training.environment.fleet import Fleet
from sprintlab.training.environment.kinematics import BodyState, Kinematics, heading_velocity
from sprintlab.training.environment.reward_sum import RewardTerms, aggregate
from sprintlab.training.environment.rewards import Loads, RewardInput, angular_tracking, linear_tracking
from sprintlab.training.graphs import captured, compiled
from sprintlab.training.learner.metric_buffer import MetricBuffer
from sprintlab.training.scaling import length_scale, speed_scale
from sprintlab.training.settings import PHASES, TrainingSettings

POLICY_STEP, SUBSTEPS = 1.0 / POLICY_RATE_HZ, 80
"""Policy step [s], and physics steps in it: the plant's own 0.25 ms. Running agrees with 0.5 ms, too, but the
fastest joint of a brake from top speed is then 6 % slow, and the audit's limit is not practised."""
EPISODE_LENGTH = (14.0, 24.0)
"""Least and greatest length of an episode [s], drawn per environment, so that ends do not synchronise."""
SHORTEST_STRIDE, SHORTEST_STANCE = 0.194, 0.036
"""A foot is hasty that touches down sooner after its last touchdown, or lifts off sooner after it [s]; for
the robot that the settings are for, for others by ``scaling``."""
KNEE_CLEARANCE = 0.05
"""A knee that comes closer to the ground ends the episode [m]; scaled likewise."""
WINDING_TEMPERATURE = (25.0, 90.0)
"""With heat, at an episode's start [degC]."""
SPEED_AVERAGE = 0.1
"""Weight of the newest speed in the running speed that the command schedule follows."""
_LARGEST_OBSERVATION = 50.0
_FORGETTING = 0.02
"""By which a robot's own record sinks [m/s in a second]."""
_LOGGED = (
    "tracking", "turning", "reward", "speed", "command_error", "falls", "power", "contact", "on_limit",
    "tilt", "vertical_speed", "broken", "electrical_power",
    "ended_share", *(f"fast/{phase}" for phase in PHASES), *(f"broken/{name}" for name in WATCHED),
)  # fmt: skip
_PERCENTILES = {"speed_median": 0.5, "speed_p95": 0.95}


ENGINE_STATE = (
    "bristle", "winding_temperature", "state_of_charge", "recent_force", "loaded", "since_touchdown",
    "carried",
)  # fmt: skip
"""What the engine keeps of a robot beside position and velocity: a copy takes it over."""
_LONG_AGO = 1.0
"""Time since its last touchdown of a foot that has not touched down yet [s]."""


def engine_options(settings: TrainingSettings) -> EngineOptions:
    """The engine of a training."""
    simulation = settings.simulation
    return EngineOptions(
        robots=simulation.environments,
        timestep=POLICY_STEP / SUBSTEPS,
        substeps=SUBSTEPS,
        motor_model=settings.actuator_model,
        saturation=simulation.saturation,
        heat=simulation.heat,
        battery=simulation.battery,
    )


class SprintEnvironment:
    """``n`` robots that chase scheduled commands.

    Everything that it hands out is a buffer of its own, which the next step writes over; where a learner
    keeps references, ``sprintlab.integrations.rsl_rl`` hands out copies.

    Observation groups: ``actor`` ``(n, 45 H)`` with noise and filter, ``critic`` ``(n, 53)``: clean frame,
    body velocity 3, height 1, foot contacts 4. ``estimate`` ``(n, 8)`` is the low-passed estimate that an
    actor with an estimator keeps here, since it must follow the resets.

    Args:
        fused: graphs and compiled kernels (GPU only).
        rank: rank of the process among those that train together; each has its own random numbers.
    """

    def __init__(
        self, settings: TrainingSettings, device: str = "cuda:0", fused: bool = True, rank: int = 0
    ) -> None:
        torch.manual_seed(settings.seed + 1_000_003 * rank)
        self.settings, self.device = settings, device
        self.cfg = settings.as_dict()
        self.robot = load_robot(settings.robot)
        self.num_envs, self.num_actions = settings.simulation.environments, len(self.robot.joint_names)
        self.engine = Engine(self.robot, engine_options(settings), device)
        self.fleet = Fleet(self.engine, settings.randomization)
        self.slope, self.mean_delay = self.fleet.slope, self.fleet.delay
        self.kinematics = Kinematics(self.robot, self.engine, self.slope)
        self.friction = self.engine.friction
        no_load = no_load_speed(self.robot.motors, self.robot.bus_voltage) / self.robot.gear.ratio
        self.no_load_speed = torch.as_tensor(no_load, dtype=torch.float32, device=device)
        self.observation = settings.observation.for_joints(self.num_actions)
        self.draws = Draws(self.num_envs, self.observation, device)
        self._filter = LowPass()
        self._standing = StandingContract()
        self._allocate_constants()
        self._allocate_state()
        self.set_curriculum(1.0, -1.0, 0.0, settings.stages.is_steady(0))
        self._start_all()
        self.after_physics: Callable[[], None] = self._after_physics
        if fused and str(device).startswith("cuda"):
            self._transition = compiled(self._transition, fused, pointwise_cat=True)
            self.after_physics = captured(self._after_physics, device)
            self._start_all()

    # --- memory ------------------------------------------------------------------------------------------

    def _allocate_constants(self) -> None:
        def tensor(values: Any) -> torch.Tensor:
            return torch.tensor(values, dtype=torch.float32, device=self.device)

        robot, noise = self.robot, self.settings.disturbances
        self._default_pose, self._action_scale = tensor(robot.default_pose), tensor(robot.action_scale)
        self._stop_lower = tensor(robot.position_limits[:, 0] + robot.soft_stop.zone)
        self._stop_upper = tensor(robot.position_limits[:, 1] - robot.soft_stop.zone)
        self._terms = RewardTerms(self.settings.reward, self.device)
        sizes = self.observation.sensor_sizes
        self._noise = tensor([getattr(noise, name) for name in sizes for _ in range(sizes[name])])
        self._standing_qpos = tensor(self.engine.mj_model.key("stand").qpos)
        self._pace = speed_scale(robot)
        self.engine.shortest.copy_(self._pace * tensor((SHORTEST_STRIDE, SHORTEST_STANCE)))
        self._knee_clearance = length_scale(robot) * KNEE_CLEARANCE
        self._joint_offset = self.fleet.joint_offset
        nothing = torch.zeros(self.num_envs, 3, device=self.device)
        still = torch.zeros_like(self._joint_offset)
        self._measured_offset = join_proprioception(Measurement(nothing, nothing, self._joint_offset, still))

    def _allocate_state(self) -> None:
        n, joints = self.num_envs, self.num_actions

        def zeros(*shape: int) -> torch.Tensor:
            return torch.zeros(*shape, device=self.device)

        layout = self.observation
        self.action, self.previous_action, self.earlier_action = (zeros(n, joints) for _ in range(3))
        self.last_joint_velocity, self.running_speed = zeros(n, joints), zeros(n)
        self.running_yaw_rate, self.running_side_speed, self.course = zeros(n), zeros(n), zeros(n)
        self.running_command = zeros(n, 3)
        self.filtered, self.estimate = zeros(n, self.observation.measured_size), zeros(n, ESTIMATE_SIZE)
        self.held = zeros(n)  # share of the default pose in the next targets
        self.history = zeros(n, layout.history_length, layout.frame_size)
        self.commands: CommandState = initial_state(n, zeros(1))
        self.tracked = zeros(n, 3)  # sums over a target's time: both kernels, steps
        self.grid = self.settings.schedule.targets.grid
        self.grid_weights = zeros(1, 1) if self.grid is None else self.grid.initial_weights(zeros(1))
        self.episode_length_buf = torch.zeros(n, dtype=torch.long, device=self.device)
        shortest, longest = EPISODE_LENGTH
        lengths = shortest + (longest - shortest) * torch.rand(n, device=self.device)
        self.episode_limit = (lengths / POLICY_STEP).long()
        self.max_episode_length = int(longest / POLICY_STEP)
        self.lower, self.upper, self.stage, self.steady = (
            torch.zeros((), device=self.device) for _ in range(4)
        )
        self.weights = self._terms.weights
        self.reward, self.time_out, self.ended_share = zeros(n), zeros(n), zeros(n)
        self.phases, self.broken_parts = zeros(n, len(PHASES)), zeros(n, len(WATCHED))
        self.chances = zeros(len(WATCHED))
        self.record = zeros(n)  # best running speed of late
        self.handedness = torch.ones(n, 1, device=self.device)
        self.done = torch.zeros(n, dtype=torch.long, device=self.device)
        self.actor_observation, self.critic_observation = (
            zeros(n, size) for size in (layout.input_size, layout.frame_size + ESTIMATE_SIZE)
        )
        self._ended_episodes = zeros(2)  # how many, and their policy steps together
        self._log_sums = zeros(len(_LOGGED) + len(self.weights))
        self._logged_steps = 0

    # --- curriculum --------------------------------------------------------------------------------------

    def set_curriculum(self, upper: float, lower: float, stage: float, steady: bool = False) -> None:
        """Range of commanded speeds [m/s], share of stage II in the reward weights, whether it is steady."""
        self.upper.fill_(upper)
        self.lower.fill_(lower)
        self.stage.fill_(stage)
        self.steady.fill_(float(steady))
        self._terms.set_stage(stage, steady)

    # --- a step ------------------------------------------------------------------------------------------

    def get_observations(self) -> dict[str, torch.Tensor]:
        """The present observations by group: the environment's own buffers."""
        return {"actor": self.actor_observation, "critic": self.critic_observation}

    def step(
        self, actions: torch.Tensor
    ) -> tuple[dict[str, torch.Tensor], torch.Tensor, torch.Tensor, dict[str, torch.Tensor]]:
        """One policy step of 20 ms: observations, rewards (per second times 0.02 s), reset mask, time-outs.

        All of it are the environment's own buffers.
        """
        self.write_action(actions)
        self.advance()
        return self.get_observations(), self.reward, self.done, {"time_outs": self.time_out}

    def write_action(self, actions: torch.Tensor) -> None:
        """Turn actions ``(n, joints)`` into the joint targets of the next ``advance``.

        Robots that stand as they are asked to are held in the default pose, whatever their action.
        """
        self.action.copy_(((1.0 - self.held)[:, None] * actions).clamp(-ACTION_LIMIT, ACTION_LIMIT))
        target = joint_targets(self.action, self._default_pose, self._action_scale, ACTION_LIMIT)
        target = target - self._joint_offset
        self.engine.previous_target.copy_(self.engine.target)
        self.engine.target.copy_(target)

    def advance(self, between: Callable[[], None] = lambda: None) -> None:
        """Physics, then rewards, ends, resets, commands and observations.

        Args:
            between: called after physics, for example to note the time.
        """
        self.engine.step()
        between()
        self.after_physics()
        self._logged_steps += 1

    def _after_physics(self) -> None:
        self.draws.refill()
        self._transition()

    # --- the step after physics --------------------------------------------------------------------------

    @torch.no_grad()
    def _transition(self) -> None:
        """From the state after physics to the next observation, given this step's random numbers."""
        self.episode_length_buf.add_(1)
        body = self.kinematics.read()
        self.running_speed.add_(SPEED_AVERAGE * (body.velocity[:, 0] - self.running_speed))
        self.running_side_speed.add_(SPEED_AVERAGE * (body.velocity[:, 1] - self.running_side_speed))
        self.running_yaw_rate.add_(SPEED_AVERAGE * (body.angular_velocity[:, 2] - self.running_yaw_rate))
        self.running_command.add_(SPEED_AVERAGE * (self.commands.command - self.running_command))
        ends = find_ends(
            body,
            self.engine.qvel,
            self.episode_length_buf,
            self.episode_limit,
            self._knee_clearance,
        )
        self._count_episodes(ends)
        self._reward(body, ends)
        self.time_out.copy_(ends.timed_out)
        self.done.copy_(ends.any)
        self.earlier_action.copy_(self.previous_action)
        self.previous_action.copy_(self.action)
        self.last_joint_velocity.copy_(body.joint_velocity)
        self._learn_grid(ends)
        self._push()
        self._jitter_delay()
        reset_mask = self._restart(ends.any)
        self._advance_commands(reset_mask)
        self._observe(reset_mask)

    def _reward(self, body: BodyState, ends: Ends) -> None:
        above = (body.joint_position - self._stop_upper).clamp(min=0.0)
        below = (self._stop_lower - body.joint_position).clamp(min=0.0)
        inputs = RewardInput(
            body=body,
            command=self.commands.command,
            target_speed=self._followed_speed(),
            action=self.action,
            previous_action=self.previous_action,
            earlier_action=self.earlier_action,
            joint_acceleration=(body.joint_velocity - self.last_joint_velocity) / POLICY_STEP,
            torque=self.engine.torque,
            limit_excess=above + below,
            base_height_target=self.robot.base_height_target,
            loads=Loads(*(getattr(self.engine, name) for name in Loads._fields)),
            running_speed=self.running_speed,
            running_yaw_rate=self.running_yaw_rate,
            running_side_speed=self.running_side_speed,
            running_command=self.running_command,
            weight=self.engine.weight,
            no_load_speed=self.no_load_speed,
        )
        earned = self._terms.earned(inputs)
        rate = torch.nan_to_num(aggregate(earned.paid, earned.penalties, self.settings.reward_sum))
        self.reward.copy_(torch.where(ends.failed, torch.zeros_like(rate), rate) * POLICY_STEP)
        self._constrain(inputs)
        self._log(inputs, rate, ends, earned.parts)

    def _constrain(self, inputs: RewardInput) -> None:
        """The share of the future that ends with this step."""
        settings = self.settings.constraints
        if settings is None:
            return
        parts = broken_parts(self._monitors(), settings)
        phases = command_phases(inputs.command[:, 0], inputs.target_speed, inputs.running_speed)
        self.phases.copy_(phases)
        self.broken_parts.copy_(by_phase(phases, parts))
        self.ended_share.copy_(ended_share(self.broken_parts, self.chances))

    def _monitors(self) -> Monitors:
        """What the audit measures in this step."""
        engine, command = self.engine, self.commands.command
        weight = apparent_weight(command[:, 0] * command[:, 2])[:, None]
        deflection = nominal_deflection(engine.pad_deflection, engine.pad_stiffness[:, None])
        return Monitors(
            foot_force=engine.foot_force / weight,
            pad_deflection=deflection / weight,
            gear_torque=engine.gear_torque,
            leg_distance=engine.leg_distance,
            joint_speed=engine.joint_speed,
            stop_depth=engine.stop_depth / self.robot.soft_stop.zone,
        )

    def _followed_speed(self) -> torch.Tensor:
        """Where the commanded speed is on its way to [m/s]: itself under a schedule that knows no targets."""
        follows = getattr(self.settings.schedule, "follows_targets", True)
        return self.commands.target_speed if follows else self.commands.command[:, 0]

    def _log(
        self,
        inputs: RewardInput,
        rate: torch.Tensor,
        ends: Ends,
        parts: torch.Tensor,
    ) -> None:
        """Add this step's means to the sums, in the order of ``_LOGGED``; read once an iteration."""
        body = inputs.body
        forward = body.velocity[:, 0]
        fast = (self.running_speed > FAST_SHARE * self.upper).float()[:, None]
        values = (
            linear_tracking(inputs, speed=self._pace),
            angular_tracking(inputs, sharpness=self._pace**2),
            rate,
            forward,
            (inputs.command[:, 0] - forward).abs(),
            ends.failed.float(),
            (inputs.torque * body.joint_velocity).clamp(min=0.0).sum(1),
            body.contact.mean(1),
            self.engine.limit_share.mean(1),
            body.gravity[:, :2].norm(dim=1),
            body.velocity[:, 2].abs(),
            ends.broken.float(),
            self.engine.power,
            self.ended_share,
            *(self.phases * fast).unbind(1),
            *(self.broken_parts * fast).unbind(1),
        )
        means = torch.cat((torch.stack(values, 1), parts), 1)
        self._log_sums.add_(torch.nan_to_num(means).mean(0))

    def _learn_grid(self, ends: Ends) -> None:
        """What robots make of their targets goes into the grid that draws them."""
        if self.grid is None:
            return
        outcome = self._outcome(ends)
        self.grid_weights.copy_(self.grid.update(self.grid_weights, outcome))
        self.tracked.mul_((~(outcome.due | ends.any)).float()[:, None])

    def _outcome(self, ends: Ends) -> TargetOutcome:
        """How every robot does on its target."""
        commands = self.commands
        speed_error = commands.target_speed - self.running_speed
        yaw_error = commands.command[:, 2] - self.running_yaw_rate
        shares = torch.stack((speed_error / self._pace, yaw_error * self._pace), 1)
        kernels = torch.exp(-shares.square())
        self.tracked.add_(torch.cat((torch.nan_to_num(kernels), torch.ones_like(kernels[:, :1])), 1))
        left = (commands.time_to_target / POLICY_STEP - 1.0).clamp(min=0.0)
        return TargetOutcome(
            speed=commands.target_speed,
            yaw_rate=commands.command[:, 2],
            speed_error=speed_error,
            yaw_error=yaw_error,
            tracking=self.tracked[:, :2] / (self.tracked[:, 2] + left)[:, None],
            due=(commands.time_to_target <= POLICY_STEP) & ~ends.any,
            failed=ends.failed,
        )

    def _push(self) -> None:
        """Now and then a kick: a random change of the horizontal base velocity."""
        settings, draw = self.settings.disturbances, self.draws["push"]
        kicked = (draw[:, :1] < POLICY_STEP / settings.push_interval).float()
        self.engine.qvel[:, :2] += kicked * settings.push_speed * (2 * draw[:, 1:] - 1)

    def _jitter_delay(self) -> None:
        """How late the next targets reach the joints, in physics steps."""
        late = self.mean_delay + self.fleet.delay_jitter * (2 * self.draws["delay"][:, 0] - 1)
        self.engine.delay.copy_(late.round().clamp(min=0.0, max=SUBSTEPS))

    # --- resets ------------------------------------------------------------------------------------------

    def _start_all(self) -> None:
        """Fresh starts everywhere; no copies, since no robot runs yet."""
        self.draws.refill()
        self.episode_length_buf.zero_()
        everyone = torch.ones(self.num_envs, dtype=torch.bool, device=self.device)
        reset_mask = self._restart(everyone)
        self._advance_commands(reset_mask)
        self._observe(reset_mask)
        self._log_sums.zero_()
        self._ended_episodes.zero_()
        if self.grid is not None:
            self.grid_weights.copy_(self.grid.initial_weights(self.grid_weights))

    def _restart(self, mask: torch.Tensor) -> torch.Tensor:
        """Restart the robots in ``mask``; returns those that start fresh, not as another's copy."""
        starts = choose_starts(
            mask, self.running_speed, self.episode_length_buf, self.draws, self.settings.episodes
        )
        self._place(mask, starts.donors, starts.copied)
        # A copy takes over what belongs to the running robot; a fresh start begins from zero.
        zero_at_start = (
            self.previous_action, self.earlier_action, self.estimate, self.running_yaw_rate,
            self.running_side_speed,
        )  # fmt: skip
        for buffer in zero_at_start:
            started = where_rows(starts.restarted, torch.zeros_like(buffer), buffer)
            buffer.copy_(where_rows(starts.copied, buffer[starts.donors], started))
        drawn = torch.where(self.draws["handedness"] < 0.5, 1.0, -1.0)
        self._put(self.handedness, starts.restarted, drawn)
        taken_over = (
            self.filtered, self.history, self.held, self.course, self.tracked, self.handedness,
            self.running_command, *self.commands,
        )  # fmt: skip
        for buffer in taken_over:
            self._put(buffer, starts.copied, buffer[starts.donors])
        for name in ENGINE_STATE:
            buffer = getattr(self.engine, name)
            self._put(buffer, starts.copied, buffer[starts.donors])
            self._put(buffer, starts.restarted, self._at_start(name, buffer))
        self.episode_length_buf.mul_((~mask).long())
        return starts.restarted

    def _at_start(self, name: str, buffer: torch.Tensor) -> torch.Tensor:
        """What the engine keeps of a robot in the air: no contact, windings as drawn, a full battery."""
        if name == "winding_temperature":
            lowest, highest = WINDING_TEMPERATURE
            drawn = lowest + (highest - lowest) * self.draws["temperature"]
            return buffer if self.settings.simulation.heat is None else drawn
        return torch.full_like(buffer, {"since_touchdown": _LONG_AGO, "state_of_charge": 1.0}.get(name, 0.0))

    def _place(self, mask: torch.Tensor, donors: torch.Tensor, copied: torch.Tensor) -> None:
        """Write position, velocity, joint targets and what follows from them for the robots in ``mask``."""
        engine = self.engine
        qpos, qvel = standing_starts(
            self._standing_qpos,
            self.kinematics.joint_qpos,
            engine.qvel.shape[1],
            self.upper,
            self.draws,
            self.settings.episodes,
        )
        donor_qpos = engine.qpos[donors]
        donor_qpos[:, :2] = 0.0
        qpos = where_rows(copied, donor_qpos, qpos)
        qvel = where_rows(copied, engine.qvel[donors], qvel)
        forward = heading_velocity(qpos[:, 3:7], qvel[:, :3])[:, 0]
        forward = torch.where(copied, self.running_speed[donors], forward)
        target = where_rows(copied, engine.target[donors], self._default_pose.expand_as(engine.target))
        self._put(self.last_joint_velocity, mask, qvel[:, self.kinematics.joint_qvel])
        self._put(self.running_speed, mask, forward)
        self._put(engine.target, mask, target)
        self._put(engine.qpos, mask, qpos)
        self._put(engine.qvel, mask, qvel)

    @staticmethod
    def _put(buffer: torch.Tensor, mask: torch.Tensor, values: torch.Tensor) -> None:
        """Write the masked rows of ``values`` into ``buffer``."""
        buffer.copy_(where_rows(mask, values, buffer))

    # --- commands and observations -----------------------------------------------------------------------

    def _advance_commands(self, reset_mask: torch.Tensor) -> None:
        before = self.commands.time_to_target
        step = CommandStep(
            speed=self.running_speed,
            dt=POLICY_STEP,
            lower=self.lower,
            upper=self.upper,
            friction=self.friction,
            reset_mask=reset_mask,
            random=self.draws["command"],
            weights=self.grid_weights,
            steady=self.steady,
        )
        advanced = self.settings.schedule.advance(self.commands, step)
        renewed = reset_mask | (advanced.time_to_target > before)
        advanced = advanced._replace(target_speed=self._within_record(advanced.target_speed, renewed))
        advanced = self._hold_heading(advanced, renewed)
        for buffer, value in zip(self.commands, advanced, strict=True):
            buffer.copy_(value)
        self._put(self.running_command, reset_mask, self.commands.command)

    def _within_record(self, target: torch.Tensor, renewed: torch.Tensor) -> torch.Tensor:
        """New targets of the fine-tuning phase: scaled to what the robot has lately run, and a margin."""
        margin = self.settings.stages.record_margin
        if margin is None:
            return target
        self.record.copy_(torch.maximum(self.record - _FORGETTING * POLICY_STEP, self.running_speed))
        share = ((self.record + margin) / self.upper.clamp(min=1.0)).clamp(max=1.0)
        share = 1.0 - self.steady * (1.0 - share)
        return torch.where(renewed & (target > 0.0), share * target, target)

    def _hold_heading(self, commands: CommandState, renewed: torch.Tensor) -> CommandState:
        """Where no turn is wanted: the yaw rate back to the heading at which the target was drawn."""
        heading = heading_angle(self.engine.qpos[:, 3:7])
        self.course.copy_(torch.where(renewed, heading, self.course))
        speed, turn = commands.command[:, 0], commands.command[:, 2]
        back = heading_command(heading - self.course, torch.zeros_like(speed), speed, friction=self.friction)
        straight = commands.target_yaw_rate == 0.0
        yaw_rate = torch.where(straight, torch.nan_to_num(back), turn)
        return commands._replace(command=torch.stack((speed, commands.command[:, 1], yaw_rate), 1))

    def _hold(self, reset_mask: torch.Tensor, gravity: torch.Tensor) -> torch.Tensor:
        """Hold robots that stand as they are asked to, as the runtime does; returns those let go just now.

        Those have forgotten what the network saw and did. A robot begins held, unless it begins fast; one
        without an estimate has an actor without an estimator, which no runtime holds.
        """
        estimated = (self.estimate != 0.0).any(1)
        held = standing_share(
            self._standing,
            torch.where(
                reset_mask, (self.running_speed.abs() < self._standing.hold_speed).float(), self.held
            ),
            command=self.commands.command,
            velocity=torch.where(reset_mask[:, None], self.running_speed[:, None], self.estimate[:, :2]),
            gravity=gravity,
            rate_hz=1.0 / POLICY_STEP,
        )
        held = torch.where(reset_mask | estimated, held, torch.zeros_like(held))
        released = (self.held > 0.0) & (held == 0.0) & ~reset_mask
        self.held.copy_(held)
        self._put(self.previous_action, released, torch.zeros_like(self.previous_action))
        self._put(self.estimate, released, torch.zeros_like(self.estimate))
        return released

    def _observe(self, reset_mask: torch.Tensor, body: BodyState | None = None) -> None:
        """Hold; noise, filter, frame, history for the actor; no noise in the critic's observation.

        Args:
            reset_mask: robots that begin ``(n,)``.
            body: the present state, where it has been read already.
        """
        body = body or self.kinematics.read()
        released = self._hold(reset_mask, body.gravity)
        parts = Measurement(
            body.angular_velocity, body.gravity, body.joint_position - self._default_pose, body.joint_velocity
        )
        clean = torch.nan_to_num(join_proprioception(parts))
        noisy = clean + self._noise * (2 * self.draws["noise"] - 1) + self._measured_offset
        self.filtered.copy_(self._filter.step(self.filtered, noisy, reset_mask))
        frame = self._frame(self.filtered)
        self.history.copy_(update_history(self.history, frame, reset_mask | released))
        self.actor_observation.copy_(network_input(self.history))
        privileged = (body.velocity, body.height[:, None], body.contact)
        critic = torch.nan_to_num(torch.cat((self._frame(clean), *privileged), 1))
        self.critic_observation.copy_(critic.clamp(-_LARGEST_OBSERVATION, _LARGEST_OBSERVATION))

    def _frame(self, proprioception: torch.Tensor) -> torch.Tensor:
        measured, command = split_proprioception(proprioception), self.commands.command
        frame = observation_frame(self.settings.observation, measured, command, self.previous_action)
        return frame.clamp(-_LARGEST_OBSERVATION, _LARGEST_OBSERVATION)

    # --- statistics --------------------------------------------------------------------------------------

    def _count_episodes(self, ends: Ends) -> None:
        """Add the episodes that end to those that have ended since the log was taken."""
        length = torch.where(ends.any, self.episode_length_buf, 0)
        self._ended_episodes.add_(torch.stack((ends.any.sum(), length.sum())))

    def take_log(self) -> MetricBuffer:
        """Means since the last call, contribution of each reward term, speed percentiles, episode length.

        The length is the mean of the episodes that have ended since [s]; 0 where none has.
        """
        speeds = torch.stack(
            ranked_speeds(torch.nan_to_num(self.running_speed), tuple(_PERCENTILES.values()))
        )
        means = self._log_sums / max(1, self._logged_steps)
        ended, steps = self._ended_episodes.unbind()
        length = POLICY_STEP * steps / ended.clamp(min=1.0)
        values = torch.cat((means, speeds, torch.stack((self.grid_weights.mean(), length))))
        self._log_sums.zero_()
        self._ended_episodes.zero_()
        self._logged_steps = 0
        terms = (f"reward/{name}" for name in self.settings.reward)
        return MetricBuffer((*_LOGGED, *terms, *_PERCENTILES, "grid_open", "episode_length"), values)
