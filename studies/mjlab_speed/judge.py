"""Judgement: a policy on our plant, under the law of its training and under the refined law."""

from __future__ import annotations

import itertools
import json
import multiprocessing
import shutil
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import mujoco
import numpy as np

from sprintlab.control import PolicyRuntime, load_policy, shipped_policy
from sprintlab.core.array_types import FloatArray
from sprintlab.evaluation.rollout_audit import audit_rollout
from sprintlab.evaluation.rollouts import Rollout
from sprintlab.motors import DriveOutput
from sprintlab.plant import Plant, PlantOptions, TrialSettings
from sprintlab.robots import RobotDescription, load_robot, match_joints, robot_motors
from studies.mjlab_speed.train import ACTUATORS, NO_LOAD_SPEED, STALL_TORQUE

COMMANDS = tuple(np.arange(1.0, 6.01, 0.5))
RISE, HOLD, JUDGED = 2.0, 5.0, 2.0  # [m/s^2], [s], the hold's last [s]
SHIPPED, SHIPPED_COMMANDS, SHIPPED_RESULT = "go1-sprint", (4.0, 5.0, 6.0, 7.0, 8.0), "shipped.json"
FACTS = ("actuator", "seed", "environments", "iterations", "top")
POLICY_STEPS = 20  # motor steps of 1 ms in one decision
HEADING_GAIN, LARGEST_YAW_RATE = 0.5, 0.7  # as in mjlab's heading commands [1/s], [rad/s]
IMU = np.array([-0.01592, -0.06659, -0.00617])  # place of the sensor in the trunk of mjlab's Go1 [m]


class Policy(NamedTuple):
    """An actor of rsl_rl: normalization, then layers with ELUs between them."""

    mean: FloatArray
    deviation: FloatArray
    layers: tuple[tuple[FloatArray, FloatArray], ...]
    home: FloatArray
    scale: FloatArray
    joint_names: tuple[str, ...]
    facts: dict[str, Any]
    """Of the training: actuator, seed, robots, iterations, and the fastest command at its end [m/s]."""

    def action(self, observation: FloatArray) -> FloatArray:
        """Joint offsets before scaling ``(12,)``, in the order of ``joint_names``."""
        value = (observation - self.mean) / self.deviation
        for index, (weight, bias) in enumerate(self.layers):
            value = weight @ value + bias
            if index < len(self.layers) - 1:
                value = np.where(value > 0.0, value, np.expm1(np.minimum(value, 0.0)))
        return value


def load(path: Path) -> Policy:
    """Read what ``export`` wrote."""
    with np.load(path) as found:
        weights = sorted(
            (name for name in found if name.startswith("actor.mlp.") and name.endswith("weight")),
            key=lambda name: int(name.split(".")[2]),
        )
        layers = tuple((found[name], found[name.replace("weight", "bias")]) for name in weights)
        return Policy(
            mean=found["actor.obs_normalizer._mean"].ravel(),
            deviation=found["actor.obs_normalizer._std"].ravel() + 1e-2,  # rsl_rl's own epsilon
            layers=layers,
            home=found["home"],
            scale=found["scale"],
            joint_names=tuple(map(str, found["joint_names"])),
            facts={name: found[name].item() for name in FACTS},
        )


def mjlabs_go1(policy: Policy) -> RobotDescription:
    """Our Go1 with the gains and the pose of mjlab's."""
    robot, inertia = load_robot("go1"), 0.000111842 * np.tile([36.0, 36.0, 81.0], 4)
    places = match_joints(policy.joint_names, robot.joint_names)
    home = np.empty(12)
    home[places] = policy.home
    frequency = 20.0 * 3.1415926535
    return replace(
        robot, default_pose=home, stiffness=inertia * frequency**2, damping=4.0 * inertia * frequency
    )


def promised_law(law: str) -> Callable[[FloatArray, FloatArray], DriveOutput] | None:
    """The law that a policy was trained with, for the plant's joints; ``None`` where the plant has it."""
    if law == "refined":
        return None
    kinds = ("hip", "thigh", "calf") * 4
    stall = np.array([STALL_TORQUE[kind] for kind in kinds])
    top = np.array([NO_LOAD_SPEED[kind] for kind in kinds])

    def given(wanted: FloatArray, speed: FloatArray) -> DriveOutput:
        line = speed / top if law == "data-sheet" else 0.0 * speed
        lower, upper = np.maximum(stall * (-1.0 - line), -stall), np.minimum(stall * (1.0 - line), stall)
        torque = np.clip(wanted, lower, upper)
        return DriveOutput(torque, torque, lower, upper, 0.0 * torque)

    return given


class Trial(NamedTuple):
    """One command held."""

    command: float
    """[m/s]"""
    speed: float
    """Mean forward speed over the last two seconds of the hold [m/s]; up to the fall where the robot fell."""
    fell: bool
    rollout: Rollout
    """Joint speeds and delivered torques of the hold."""
    unmet: float
    """Share of the wanted torque, over time and joints, that the drive does not give [-]."""


Controller = Callable[[Plant, FloatArray], FloatArray]
"""From the plant and the command (forward, sideways [m/s], yaw rate [rad/s]) to joint targets [rad]."""


def mjlabs_controller(policy: Policy, robot: RobotDescription) -> Controller:
    """A policy of mjlab's task, from its first step."""
    places, action = match_joints(policy.joint_names, robot.joint_names), np.zeros(12)

    def decide(plant: Plant, command: FloatArray) -> FloatArray:
        action[:] = policy.action(observation(plant, policy, places, action, command))
        targets = np.empty(12)
        targets[places] = policy.home + policy.scale * action
        return targets

    return decide


def shipped_controller(robot: RobotDescription) -> Controller:
    """``go1-sprint``, which comes with the package."""
    runtime = PolicyRuntime(load_policy(shipped_policy(SHIPPED)), robot)
    runtime.reset()
    return lambda plant, command: np.asarray(runtime.step(plant.measurement(), command), dtype=float)


def hold(
    robot: RobotDescription, decide: Controller, law: str, command: float, seed: int, hold_time: float = HOLD
) -> Trial:
    """Rise to a commanded speed and hold it, on our plant, under the law of a training or ``refined``."""
    plant = Plant(robot, PlantOptions(), TrialSettings(seed=seed, joint_noise=0.05))
    if (drive := promised_law(law)) is not None:
        plant.use_drive(drive)
    samples, speeds = [], []
    begin = 1.0 + command / RISE
    while plant.time < begin + hold_time and not plant.fall_reason:
        asked = min(command, max(0.0, plant.time - 1.0) * RISE)
        yaw = np.clip(-HEADING_GAIN * plant.base_state().heading, -LARGEST_YAW_RATE, LARGEST_YAW_RATE)
        targets = decide(plant, np.array([asked, 0.0, yaw]))
        for _ in range(POLICY_STEPS):
            position, velocity = plant.joint_state()
            position, velocity = position.copy(), velocity.copy()
            wanted = robot.stiffness * (targets - position) - robot.damping * velocity
            output = plant.drive_joints(wanted, targets)
            if plant.time >= begin:
                samples.append((velocity, wanted, output.torque.copy()))
        speeds.append((plant.time, plant.base_state().forward_speed))
    samples = samples or [(np.zeros(12),) * 3] * 2  # fell before the hold began
    velocity, wanted, torque = np.swapaxes(np.array(samples), 0, 1)
    late = [speed for moment, speed in speeds if moment > begin + hold_time - JUDGED]
    return Trial(
        command=command,
        speed=float(np.mean(late or [speeds[-1][1]])),
        fell=bool(plant.fall_reason),
        rollout=Rollout(
            time=0.001 * np.arange(len(velocity)),
            joint_velocity=velocity,
            joint_torque=torque,
            joint_names=robot.joint_names,
        ),
        unmet=float(np.abs(wanted - torque).sum() / max(np.abs(wanted).sum(), 1e-9)),
    )


def observation(
    plant: Plant, policy: Policy, places: Sequence[int], action: FloatArray, command: FloatArray
) -> FloatArray:
    """mjlab's 48 numbers: velocity of the IMU, rates, gravity, joints, last action, command."""
    seen = plant.measurement()
    turned = np.empty(9)
    mujoco.mju_quat2Mat(turned, plant.data.qpos[3:7])
    velocity = turned.reshape(3, 3).T @ plant.data.qvel[:3] + np.cross(seen.angular_velocity, IMU)
    return np.concatenate(
        [
            velocity,
            seen.angular_velocity,
            seen.projected_gravity,
            seen.joint_position[places] - policy.home,
            seen.joint_velocity[places],
            action,
            command,
        ]
    )


def judge_all(results: Path, commands: Sequence[float], trials: int, jobs: int) -> None:
    """Write ``result.json`` beside each policy that has none; ``results.zip`` of a training is unpacked."""
    if (packed := results / "results.zip").exists():
        shutil.unpack_archive(packed, results)
    left = [
        path for path in sorted(results.glob("*/policy.npz")) if not path.with_name("result.json").exists()
    ]
    with multiprocessing.get_context("spawn").Pool(min(jobs, len(left) or 1)) as pool:
        pool.starmap(judge, [(path, commands, range(1, trials + 1)) for path in left])
    if not (shipped := results / SHIPPED_RESULT).exists():
        judge_shipped(shipped)


def judge(path: Path, commands: Sequence[float], seeds: Sequence[int]) -> None:
    """All trials of one policy under its own law and under the refined one."""
    policy = load(path)
    robot, law = mjlabs_go1(policy), policy.facts["actuator"]
    trials = run_trials(robot, partial(mjlabs_controller, policy, robot), (law, "refined"), commands, seeds)
    found: dict[str, Any] = {**policy.facts, "trials": trials}
    found["promised"], found["delivered"] = reached(trials, law), reached(trials, "refined")
    path.with_name("result.json").write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    print(f"{path.parent.name}: promised {found['promised']}, delivered {found['delivered']}", flush=True)


def judge_shipped(path: Path) -> None:
    """The package's own Go1 policy under all three laws, at speeds that mjlab's task does not reach."""
    robot = load_robot("go1")
    trials = run_trials(robot, partial(shipped_controller, robot), ACTUATORS, SHIPPED_COMMANDS, (1,))
    path.write_text(json.dumps(trials, indent=1) + "\n", encoding="utf-8")


def run_trials(
    robot: RobotDescription,
    begin: Callable[[], Controller],
    laws: Sequence[str],
    commands: Sequence[float],
    seeds: Sequence[int],
) -> list[dict[str, Any]]:
    """What each trial came to, by law, command and seed."""
    motors, trials = robot_motors("go1"), []
    for law, command, seed in itertools.product(dict.fromkeys(laws), commands, seeds):
        one = hold(robot, begin(), law, float(command), seed)
        trials.append(
            {
                "law": law,
                "command": float(command),
                "speed": round(one.speed, 3),
                "fell": one.fell,
                "unmet": round(one.unmet, 4),
                "impossible": round(audit_rollout(one.rollout, motors).impossible, 4),
            }
        )
    return trials


def reached(trials: Sequence[dict[str, Any]], law: str) -> dict[str, float]:
    """Fastest mean speed at a command that at most a third of the trials fall at, and what it took."""
    own = [trial for trial in trials if trial["law"] == law]
    groups = [[one for one in own if one["command"] == at] for at in sorted({one["command"] for one in own})]
    held = [group for group in groups if 3 * sum(one["fell"] for one in group) <= len(group)]
    best = max(held, key=lambda group: np.mean([one["speed"] for one in group]), default=groups[0])
    return {
        "speed": round(float(np.mean([one["speed"] for one in best])), 3) if held else 0.0,
        "command": best[0]["command"],
        "impossible": round(float(np.mean([one["impossible"] for one in best])), 4),
        "unmet": round(float(np.mean([one["unmet"] for one in best])), 4),
        "falls": round(float(np.mean([one["fell"] for one in own])), 4),
    }
