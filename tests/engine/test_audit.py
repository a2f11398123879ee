"""The engine's monitors against what the audit measures in the plant, on the same motion.

The engine takes up the plant's state at the start of each policy step and makes that step with the plant's
own time step. Landings at the edge between gripping and skidding go either way with the least difference (in
the plant, too, with another time step), so a few policy steps may differ.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest
import torch

from sprintlab.commands import SpeedProfile, heading_command
from sprintlab.control import PolicyRuntime, load_policy, shipped_policies
from sprintlab.engine import Engine, EngineOptions
from sprintlab.evaluation.metrics import trial_metrics
from sprintlab.evaluation.recorder import Recorder
from sprintlab.evaluation.results import Trajectory, TrialMetrics
from sprintlab.motors import no_load_speed, saturate
from sprintlab.plant import NOMINAL_TRIAL, STANCE_FORCE, PlantOptions, open_plant
from sprintlab.robots import RobotDescription, load_robot

STEPS, PER_STEP, TIMESTEP = 240, 20, 0.00025


class Run(NamedTuple):
    """Some seconds of a policy in the plant: stand, rise, hold, and the beginning of braking."""

    robot: RobotDescription
    trajectory: Trajectory  # at 1 kHz
    audited: TrialMetrics
    qpos: np.ndarray  # at the start of each policy step, as the next three
    qvel: np.ndarray
    bristle: np.ndarray
    target: np.ndarray

    def inside(self, values: np.ndarray, first: int = 0) -> np.ndarray:
        """Samples of each policy step ``(steps, 20, ...)``; those that hold what was before begin at 1."""
        return values[first : first + STEPS * PER_STEP].reshape(STEPS, PER_STEP, *values.shape[1:])


def run(policy_name: str, robot_name: str, speed: float) -> Run:
    robot = load_robot(robot_name)
    policy = load_policy(shipped_policies()[policy_name], robot)
    plant = open_plant(robot, PlantOptions(record_rate=1000), NOMINAL_TRIAL)
    runtime, profile = PolicyRuntime(policy, robot), SpeedProfile(top_speed=speed, hold=0.8)
    recorder = Recorder(plant, STEPS * PER_STEP + 1)
    states = []
    for _ in range(STEPS):
        base, asked = plant.base_state(), float(profile.command(plant.time))
        turn = float(heading_command(base.heading, base.lateral_offset, asked))
        target = np.asarray(runtime.step(plant.measurement(), np.array([asked, 0.0, turn])), dtype=float)
        bristle = np.array(plant.pads._bristle)[:, :2]
        states.append((plant.data.qpos.copy(), plant.data.qvel.copy(), bristle, target))
        assert plant.advance(target, PER_STEP, recorder), plant.fall_reason
    recorder.sample(plant.data, plant.drive_output, target)
    trajectory = recorder.trajectory()
    audited = trial_metrics(trajectory, robot, (0.0, float(trajectory.time[-1])))
    return Run(robot, trajectory, audited, *map(np.array, zip(*states, strict=True)))


def stepped(ran: Run) -> Engine:
    """Every policy step of the run, each in a robot of its own."""
    chosen = EngineOptions(robots=STEPS, timestep=TIMESTEP, substeps=round(0.02 / TIMESTEP))
    engine = Engine(ran.robot, chosen, "cpu", double=True)
    for name in ("qpos", "qvel", "bristle", "target"):
        getattr(engine, name).copy_(torch.tensor(getattr(ran, name)))
    before = np.concatenate((np.zeros((PER_STEP, 4)), ran.trajectory.foot_force[1:]))
    for index in range(engine.options.window - 1):
        engine.recent_force[:, :, index] = torch.tensor(before[PER_STEP - 1 - index :: PER_STEP][:STEPS])
    engine.step()
    return engine


@pytest.fixture(scope="module", params=[("sprint", "bp2", 10.0), ("go1-sprint", "go1", 5.0)])
def both(request: pytest.FixtureRequest) -> tuple[Run, Engine]:
    ran = run(*request.param)
    return ran, stepped(ran)


def plant_monitors(ran: Run) -> dict[str, np.ndarray]:
    """What the engine's monitors should be, from the audit's arrays."""
    robot, moved, motors = ran.robot, ran.trajectory, ran.robot.motors
    peak = saturate(motors, np.asarray(motors.peak_torque)) * robot.gear.ratio * robot.gear.efficiency
    no_load = no_load_speed(motors, robot.bus_voltage) / np.asarray(robot.gear.ratio)
    lower, upper = robot.position_limits.T
    free, place = robot.soft_stop.zone, moved.joint_position
    depth = np.maximum(lower + free - place, place - upper + free).clip(0.0)
    return {
        "foot_force": ran.inside(moved.foot_impact, 1).max(1) / (robot.total_mass * 9.81),
        "pad_deflection": ran.inside(moved.foot_penetration, 1).max(1),
        "gear_torque": np.abs(ran.inside(moved.gear_torque, 1)).max(1) / peak,
        "joint_speed": np.abs(ran.inside(moved.joint_velocity)).max(1) / no_load,
        "stop_depth": ran.inside(depth).max(1),
        "stance": (ran.inside(moved.foot_force, 1) > STANCE_FORCE).mean(1),
        "power": ran.inside(moved.bus_power, 1).mean(1),
        "leg_distance": ran.inside(moved.leg_distance).min(1),
    }


def test_monitors_are_what_the_audit_measures(both: tuple[Run, Engine]) -> None:
    """Mean within 2 %; at most 2 % of the policy steps off by more than 5 % of the greatest value."""
    ran, engine = both
    for name, theirs in plant_monitors(ran).items():
        ours = getattr(engine, name).numpy()
        ours = ours.min(1) if name == "leg_distance" else ours
        assert ours.mean() == pytest.approx(theirs.mean(), rel=0.02, abs=1e-6), name
        far = np.abs(ours - theirs) > 0.05 * theirs.max() + 1e-6
        assert far.mean() < 0.02, name


def test_the_worst_of_a_run_is_the_audits(both: tuple[Run, Engine]) -> None:
    ran, engine = both
    audited = ran.audited
    expected = {
        "foot_force": audited.foot_force,
        "pad_deflection": audited.pad_deflection,
        "gear_torque": max(audited.gear_torque_ratio),
        "joint_speed": max(audited.joint_speed_ratio),
    }
    for name, worst in expected.items():
        assert getattr(engine, name).max().item() == pytest.approx(worst, rel=0.05), name
    nearest = ran.trajectory.leg_distance[::2].min()  # the audit looks every 2 ms
    assert engine.leg_distance.min().item() == pytest.approx(nearest, abs=1e-3)
