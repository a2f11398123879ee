"""Judgement: a policy on our plant, under the law of its training and under the refined law."""

from __future__ import annotations

import itertools
import json
import multiprocessing
import shutil
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import mujoco
import numpy as np

from sprintlab.control import PolicyRuntime, load_policy, shipped_policy
from sprintlab.core.array_types import FloatArray
from sprintlab.core.files import atomic_write_json, file_sha256
from sprintlab.evaluation.rollout_audit import audit_rollout
from sprintlab.evaluation.rollouts import Rollout
from sprintlab.motors import DriveOutput
from sprintlab.plant import Plant, PlantOptions, TrialSettings
from sprintlab.robots import RobotDescription, load_robot, match_joints, robot_motors
from studies.mjlab_speed.train import ACTUATORS, NO_LOAD_SPEED, STALL_TORQUE

COMMANDS = tuple(np.arange(1.0, 6.01, 0.5))  # [m/s]
SEEDS = (1, 2, 3)  # of the trials at each of them
RISE, HOLD, JUDGED = 2.0, 5.0, 2.0  # [m/s^2], [s], the hold's last [s]
SHIPPED, SHIPPED_COMMANDS = "go1-sprint", (4.0, 5.0, 6.0, 7.0, 8.0)
RESULT, SHIPPED_RESULT = "result.json", "shipped.json"
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
        lower, upper = (np.clip(stall * (side - line), -stall, stall) for side in (-1.0, 1.0))
        torque = np.clip(wanted, lower, upper)
        return DriveOutput(torque, torque, lower, upper, 0.0 * torque)

    return given


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
    return lambda plant, command: np.asarray(runtime.step(plant.measurement(), command), dtype=float)


def hold(
    robot: RobotDescription, decide: Controller, law: str, command: float, seed: int
) -> tuple[float, bool, Rollout]:
    """Rise to a commanded speed and hold it, on our plant, under the law of a training or ``refined``.

    Returns:
        The mean forward speed over the last two seconds [m/s] (at the fall where the robot fell), whether it
        fell, and joint speeds and delivered torques of the hold.
    """
    plant = Plant(robot, PlantOptions(), TrialSettings(seed=seed, joint_noise=0.05))
    if (drive := promised_law(law)) is not None:
        plant.use_drive(drive)
    samples, speeds = [], []
    begin = 1.0 + command / RISE
    while plant.time < begin + HOLD and not plant.fall_reason:
        asked = min(command, max(0.0, plant.time - 1.0) * RISE)
        yaw = np.clip(-HEADING_GAIN * plant.base_state().heading, -LARGEST_YAW_RATE, LARGEST_YAW_RATE)
        targets = decide(plant, np.array([asked, 0.0, yaw]))
        for _ in range(POLICY_STEPS):
            position, velocity = plant.joint_state()
            position, velocity = position.copy(), velocity.copy()
            wanted = robot.stiffness * (targets - position) - robot.damping * velocity
            torque = plant.drive_joints(wanted, targets).torque
            if plant.time >= begin:
                samples.append((velocity, torque.copy()))
        speeds.append((plant.time, plant.base_state().forward_speed))
    samples = samples or [(np.zeros(12),) * 2] * 2  # fell before the hold began
    velocity, torque = np.swapaxes(np.array(samples, dtype=np.float64), 0, 1)
    late = [speed for moment, speed in speeds if moment > begin + HOLD - JUDGED]
    rollout = Rollout(
        time=np.arange(len(velocity), dtype=np.float64) / 1000.0,
        joint_velocity=velocity,
        joint_torque=torque,
        joint_names=robot.joint_names,
    )
    return float(np.mean(late or [speeds[-1][1]])), bool(plant.fall_reason), rollout


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


def judge_all(results: Path, jobs: int) -> None:
    """Write ``result.json`` beside each policy that has none yet, and that of the shipped policy.

    ``results.zip`` of a training is unpacked first.
    """
    if (packed := results / "results.zip").exists():
        shutil.unpack_archive(packed, results)
    left = [path for path in sorted(results.glob("*/policy.npz")) if not _judged(path)]
    with multiprocessing.get_context("spawn").Pool(min(jobs, len(left) or 1)) as pool:
        pool.map(judge, left)
    judge_shipped(results / SHIPPED_RESULT)


def _judged(path: Path) -> bool:
    """Whether the result beside a policy is of this very file."""
    result = path.with_name(RESULT)
    return result.exists() and json.loads(result.read_text())["policy_sha256"] == file_sha256(path)


def judge(path: Path) -> None:
    """All trials of one policy under its own law and under the refined one."""
    policy = load(path)
    robot = mjlabs_go1(policy)
    laws = dict.fromkeys((policy.facts["actuator"], "refined"))
    trials = run_trials(robot, partial(mjlabs_controller, policy, robot), laws, COMMANDS)
    found = {**policy.facts, "policy_sha256": file_sha256(path), "trials": trials}
    atomic_write_json(path.with_name(RESULT), found)
    print(f"{path.parent.name}: judged", flush=True)


def judge_shipped(path: Path) -> None:
    """The package's own Go1 policy under all three laws, at speeds that mjlab's task does not reach."""
    robot = load_robot("go1")
    trials = run_trials(robot, partial(shipped_controller, robot), ACTUATORS, SHIPPED_COMMANDS)
    atomic_write_json(path, trials)


def run_trials(
    robot: RobotDescription, begin: Callable[[], Controller], laws: Iterable[str], commands: Iterable[float]
) -> list[dict[str, Any]]:
    """What each trial came to, by law, command and seed."""
    motors, trials = robot_motors("go1"), []
    for law, command, seed in itertools.product(laws, commands, SEEDS):
        speed, fell, rollout = hold(robot, begin(), law, float(command), seed)
        trials.append(
            {
                "law": law,
                "command": float(command),
                "speed": round(speed, 3),
                "fell": fell,
                "beyond": round(audit_rollout(rollout, motors).impossible_moments, 4),
            }
        )
    return trials
