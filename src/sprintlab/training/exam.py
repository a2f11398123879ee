"""The exam of a training: what its policy holds, and whether it keeps the audit's limits.

Nominal robots with the protocol's joint noise stand, rise at 4 m/s2, hold, fall at 4 m/s2 and stand: a third
of them to the top of the present range of speeds, the others a little below. No number of the training's log
tells what a policy will hold; this one does. It draws nothing from the training's random generators.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import torch

from sprintlab.commands import heading_angle, heading_command
from sprintlab.core.array_types import FloatArray
from sprintlab.core.constants import GRAVITY
from sprintlab.plant import NOMINAL_TRIAL
from sprintlab.training.environment.constraints import (
    FORCE_LIMIT,
    PAD_LIMIT,
    WATCHED,
    Monitors,
    broken_parts,
    command_phases,
)
from sprintlab.training.environment.episodes import find_ends
from sprintlab.training.environment.kinematics import BodyState
from sprintlab.training.environment.sprint import (
    ENGINE_STATE,
    POLICY_STEP,
    SPEED_AVERAGE,
    SprintEnvironment,
)
from sprintlab.training.graphs import captured
from sprintlab.training.learner.networks import Actor
from sprintlab.training.settings import CONSTRAINTS, PHASES, ConstraintSettings, TrainingSettings

GROUPS = {"top": 1.0, "middle": 0.92, "low": 0.84}
"""Groups of robots, and the share of the range's top that each is asked for."""
ROBOTS = 32
"""Per group."""
ACCELERATION = 4.0
STAND, HOLD, REST = 0.5, 3.5, 2.0
"""Parts of the run [s]; the held speed is the mean over the last two seconds of the hold."""
STEADY, REST_WINDOW = 2.0, 1.0
REST_SPEED, LOAD_SHARE, DUTY_FACTOR, COMMAND_SHARE = 0.3, 0.10, 0.05, 0.80
"""Limits of the audit, beside those of ``LIMITS``."""
LIMITS = {
    "foot_force": FORCE_LIMIT,
    "pad_deflection": PAD_LIMIT,
    "gear_torque": 3.0,
    "joint_speed": 1.1,
    "leg_distance": 0.0,
}
"""The audit's limits of the worst of a run: [body weights], [m], [peak torques], over no-load speed, [m]."""
TOLERANCE, MOST = 0.15, 0.9
"""The median of the robots keeps a limit, and nine of ten miss it by no more than this share of it."""
_UNKNOWN = 1e3
_DROP = 0.02
"""Height from which robots are let go, so that no foot starts in the ground [m]."""


@dataclass(frozen=True, kw_only=True)
class GroupResult:
    """What the robots of one speed did."""

    asked: float  # speed that was asked for [m/s]
    held: float  # mean forward speed of those that did not fall [m/s]; 0 where all fell
    fallen: float  # share of the robots that fell
    at_rest: float  # share of the robots that stood at the end
    worst: dict[str, float]
    """Median over the robots of each one's worst, by the names of ``LIMITS`` and ``stop_depth`` (over the end
    stop's zone)."""
    most: dict[str, float]  # what nine of ten robots keep, by the same names
    load: tuple[float, ...]
    """Each foot's share of the ground's force, at the ends of the steady policy steps ``(legs,)``."""
    duty: tuple[float, ...]  # share of the steady time that each foot stands (legs,)
    cost: float  # electrical cost of transport [-]

    @property
    def failed(self) -> list[str]:
        """Names of the limits that are not kept."""
        lines = {
            "fallen": self.fallen <= 1.0 - MOST,
            "at_rest": self.at_rest >= MOST,
            "held": self.held >= COMMAND_SHARE * self.asked,
            "load": min(self.load) >= LOAD_SHARE,
            "duty": min(self.duty) >= DUTY_FACTOR,
            **{name: self._keeps(name) for name in LIMITS},
        }
        return [name for name, kept in lines.items() if not kept]

    def _keeps(self, name: str) -> bool:
        sign = -1.0 if name == "leg_distance" else 1.0
        limit, median, most = sign * LIMITS[name], sign * self.worst[name], sign * self.most[name]
        return median <= limit and most <= limit + TOLERANCE * abs(limit)

    @property
    def reached(self) -> float:
        """The held speed as far as it was asked for [m/s]: running faster than asked is an error, too."""
        return min(self.held, self.asked)

    def row(self) -> dict[str, float]:
        """The numbers by name, as the log has them."""
        return {
            **{name: getattr(self, name) for name in ("asked", "held", "fallen", "at_rest", "cost")},
            **self.worst,
            **{f"load_{foot}": share for foot, share in enumerate(self.load)},
            "load": min(self.load),
            "duty": min(self.duty),
            "limits_failed": float(len(self.failed)),
        }


@dataclass(frozen=True, kw_only=True)
class ExamResult:
    """An exam."""

    groups: Mapping[str, GroupResult]  # results of the groups by their names
    parts: Mapping[str, float]
    """Mean part by which each constraint is broken, by phase and name (see ``constraints``)."""
    path: FloatArray
    """Generalized positions of one of the fastest robots ``(steps, nq)``, from two seconds before it is asked
    to brake to one after."""

    @property
    def best(self) -> GroupResult | None:
        """The fastest group of those that keep the limits."""
        passed = [group for group in self.groups.values() if not group.failed]
        return max(passed, key=lambda group: group.reached, default=None)

    def row(self) -> dict[str, float]:
        """The numbers by name, as the log has them."""
        row = {"exam/held": 0.0 if self.best is None else self.best.reached}
        for name, group in self.groups.items():
            row |= {f"exam/{name}/{key}": value for key, value in group.row().items()}
        return row | {f"exam/{name}": value for name, value in self.parts.items()}


class Exam(SprintEnvironment):
    """The exam's robots, their clock and their measurements, on the device of the training.

    Args:
        actor: the policy to examine, in single precision; later changes of its weights are seen.
    """

    def __init__(self, settings: TrainingSettings, device: str, actor: Actor, fused: bool = True) -> None:
        simulation = replace(settings.simulation, environments=ROBOTS * len(GROUPS))
        own = replace(settings.nominal(), simulation=simulation)
        gpus = [torch.device(device)] if device.startswith("cuda") else []
        with torch.random.fork_rng(gpus):
            super().__init__(own, device, fused=False)
            # Errors of the first pose (n, joints): every group has the same, and so has every exam.
            noise = (2 * torch.rand(ROBOTS, self.num_actions) - 1) * NOMINAL_TRIAL.joint_noise
            self._offset = noise.repeat(len(GROUPS), 1).to(self.device)
        self.actor, self._constraints = actor, settings.constraints or ConstraintSettings()
        self.engine.friction.fill_(NOMINAL_TRIAL.friction)
        self._allocate_measurements()
        self._policy_step = captured(self._examine, device) if fused else self._examine

    def _allocate_measurements(self) -> None:
        def zeros(*shape: int) -> torch.Tensor:
            return torch.zeros(*shape, device=self.device)

        n, legs = self.num_envs, len(self.robot.leg_names)
        self.step_count, self.step_total = (zeros(1).long() for _ in range(2))
        self.asked, self.upright = zeros(n), zeros(n)
        self.worst = zeros(n, len(Monitors._fields))
        self.fastest_rest = zeros(n)
        self.steady_sums = zeros(n, 3 + 2 * legs)  # steps, speed, power, each foot's force and stance
        self.part_sums, self.phase_sums = zeros(len(PHASES), len(CONSTRAINTS)), zeros(len(PHASES))
        self.path = zeros(self.steps(self.settings.stages.second_top), self.engine.qpos.shape[1])
        self._no_robot = torch.zeros(n, dtype=torch.bool, device=self.device)

    @staticmethod
    def steps(top: float) -> int:
        """Policy steps of an exam up to a speed [m/s]."""
        return math.ceil((STAND + HOLD + REST + 2.0 * top / ACCELERATION) / POLICY_STEP)

    @torch.no_grad()
    def run(self, top: float) -> ExamResult:
        """Examine the actor at speeds up to ``top`` [m/s], at most the last stage's; waits for the device."""
        steps = min(self.steps(top), len(self.path))
        self._begin(top, steps)
        for _ in range(steps):
            self._policy_step()
        return self._result(steps)

    def _begin(self, top: float, steps: int) -> None:
        """Stand all robots up, with everything measured forgotten."""
        engine, shares = self.engine, torch.tensor(list(GROUPS.values()), device=self.device)
        self.asked.copy_(top * shares.repeat_interleave(ROBOTS))
        self.step_total.fill_(steps)
        engine.qpos.copy_(self._standing_qpos)
        engine.qpos[:, 2] += _DROP
        engine.qpos[:, self.kinematics.joint_qpos] += self._offset
        engine.target.copy_(self._default_pose)
        engine.previous_target.copy_(self._default_pose)
        for name in ENGINE_STATE:
            buffer = getattr(engine, name)
            buffer.copy_(self._at_start(name, buffer))
        self.worst.fill_(-torch.inf)
        self.upright.fill_(1.0)
        zeroed = (
            engine.qvel, self.action, self.previous_action, self.earlier_action, self.estimate,
            self.running_speed, self.step_count, self.fastest_rest, self.steady_sums, self.part_sums,
            self.phase_sums, self.path, *self.commands,
        )  # fmt: skip
        for buffer in zeroed:
            buffer.zero_()
        self._observe(~self._no_robot)

    @torch.no_grad()
    def _examine(self) -> None:
        """One policy step of all robots: act, physics, measurements, commands, observation."""
        action, estimate = self.actor(self.actor_observation, self.estimate)
        self.estimate.copy_(estimate)
        self.write_action(action)
        self.engine.step()
        self.step_count.add_(1)
        body = self.kinematics.read()
        self.running_speed.add_(SPEED_AVERAGE * (body.velocity[:, 0] - self.running_speed))
        self._measure(body)
        self.earlier_action.copy_(self.previous_action)
        self.previous_action.copy_(self.action)
        self._command()
        self._observe(self._no_robot, body)

    def _command(self) -> None:
        """The profile's speed, and the yaw rate of the protocol's heading loop."""
        time, end = self._time(), self._end()
        speed = torch.minimum(ACCELERATION * (time - STAND), ACCELERATION * (end - time)).clamp(min=0.0)
        speed = torch.minimum(speed, self.asked)
        yaw_rate = heading_command(heading_angle(self.engine.qpos[:, 3:7]), self.engine.qpos[:, 1], speed)
        values = (speed, torch.zeros_like(speed), torch.nan_to_num(yaw_rate))
        self.commands.command.copy_(torch.stack(values, 1))
        braking = time >= end - self.asked / ACCELERATION
        self.commands.target_speed.copy_(torch.where(braking, torch.zeros_like(speed), self.asked))

    def _time(self) -> torch.Tensor:
        """Since the start [s] ``(1,)``."""
        return self.step_count * POLICY_STEP

    def _end(self) -> torch.Tensor:
        """When each robot's command is zero again [s] ``(n,)``."""
        return STAND + HOLD + 2.0 * self.asked / ACCELERATION

    # --- measurements ------------------------------------------------------------------------------------

    def _measure(self, body: BodyState) -> None:
        """What counts from the rise to a fall or to the end."""
        length, limit = self.episode_length_buf, self.episode_limit
        ends = find_ends(body, self.engine.qvel, length, limit, self._knee_clearance, leg_distance=-1.0)
        self.upright.mul_(1.0 - ends.failed.float())
        time = self._time()
        counted = self.upright * (time > STAND)
        monitors = self._monitors()
        worst = torch.stack([_worst(name, value) for name, value in monitors._asdict().items()], 1)
        self.worst.copy_(torch.fmax(self.worst, torch.where(counted[:, None] > 0.0, worst, -torch.inf)))
        resting = self.step_total * POLICY_STEP - time < REST_WINDOW
        self.fastest_rest.copy_(torch.fmax(self.fastest_rest, body.velocity[:, :2].norm(dim=1) * resting))
        self._sum_steady(body, counted, time)
        self._sum_parts(monitors, counted)
        self.path.index_copy_(0, self.step_count - 1, self.engine.qpos[:1])

    def _sum_steady(self, body: BodyState, counted: torch.Tensor, time: torch.Tensor) -> None:
        """Speed, power and feet over the last two seconds of the hold."""
        braking = self._end() - self.asked / ACCELERATION
        steady = counted * ((time > braking - STEADY) & (time <= braking))
        each = (torch.ones_like(steady), body.velocity[:, 0], self.engine.power)
        feet = torch.cat((self.engine.contact_force[..., 2], self.engine.stance), 1)
        values = torch.cat((torch.stack(each, 1), feet), 1)
        self.steady_sums.add_(torch.where(steady[:, None] > 0.0, values, torch.zeros_like(values)))

    def _sum_parts(self, monitors: Monitors, counted: torch.Tensor) -> None:
        """By how much each constraint is broken in each phase."""
        command, target = self.commands.command[:, 0], self.commands.target_speed
        phases = command_phases(command, target, self.running_speed) * counted[:, None]
        self.part_sums.add_(phases.T @ broken_parts(monitors, self._constraints))
        self.phase_sums.add_(phases.sum(0))

    def _result(self, steps: int) -> ExamResult:
        """Everything measured, read back."""
        measured = (self.asked, self.upright, self.fastest_rest, self.worst, self.steady_sums)
        columns = [values.double().cpu().numpy() for values in measured]
        weight = self.robot.total_mass * GRAVITY
        groups = {
            name: _group(*(values[k * ROBOTS : (k + 1) * ROBOTS] for values in columns), weight=weight)
            for k, name in enumerate(GROUPS)
        }
        means = self.part_sums.double() / self.phase_sums.double().clamp(min=1.0)[:, None]
        braking = round((STAND + HOLD + groups["top"].asked / ACCELERATION) / POLICY_STEP)
        filmed = slice(max(0, braking - 100), min(steps, braking + 50))
        return ExamResult(
            groups=groups,
            parts=dict(zip(WATCHED, means.flatten().tolist(), strict=True)),
            path=self.path[filmed].double().cpu().numpy(),
        )


def _worst(name: str, values: torch.Tensor) -> torch.Tensor:
    """The worst of a robot's joints, feet or pairs of legs ``(n,)``: the greater the worse."""
    return -values.amin(1) if name == "leg_distance" else values.amax(1)


def _group(
    asked: FloatArray,
    upright: FloatArray,
    rest: FloatArray,
    worst: FloatArray,
    steady: FloatArray,
    *,
    weight: float,
) -> GroupResult:
    """What the measurements ``(r, ...)`` of one group amount to; ``weight`` of a robot [N]."""
    stood, sums = upright > 0.0, steady[upright > 0.0].sum(0)
    steps, distance, energy = np.maximum(sums[0], 1.0), sums[1], sums[2]
    force, stance = np.split(sums[3:], 2)
    held = float(distance / steps)
    most = np.sort(worst, axis=0)[math.ceil(MOST * len(worst)) - 1]
    return GroupResult(
        asked=float(asked[0]),
        held=held,
        fallen=float(1.0 - stood.mean()),
        at_rest=float((stood & (rest < REST_SPEED)).mean()),
        worst=_named(np.median(worst, axis=0)),
        most=_named(most),
        load=tuple((force / max(force.sum(), 1e-9)).tolist()),
        duty=tuple((stance / steps).tolist()),
        cost=float(energy / steps / (weight * max(held, 0.1))),
    )


def _named(values: FloatArray) -> dict[str, float]:
    """Worst values by name; a robot that fell before the rise has none, which counts as the worst of all."""
    finite = np.where(np.isfinite(values), values, _UNKNOWN)
    named = dict(zip(Monitors._fields, finite.tolist(), strict=True))
    named["leg_distance"] = -named["leg_distance"]
    return named
