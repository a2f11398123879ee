"""How policies run in the engine, against the plant: held speed, stride, power and foot force at four speeds.

python benchmarks/engine_running.py --output engine_running.json

Each policy runs the profile with a hold of five seconds, once in the plant and, with several time steps, in
the engine; numbers are of the last three seconds of the hold. Given are medians of four robots of the engine
and of two trials of the plant, which differ in their starts.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import numpy as np
import torch

from sprintlab.commands import SpeedProfile, heading_command
from sprintlab.control import Measurement, PolicyRuntime, load_policy, projected_gravity, shipped_policies
from sprintlab.core.constants import GRAVITY
from sprintlab.engine import Engine, EngineOptions
from sprintlab.evaluation.metrics import stride_frequency
from sprintlab.evaluation.trial import TrialRequest, run_trial
from sprintlab.plant import JOINT_NOISE, TrialSettings
from sprintlab.robots import RobotDescription, load_robot

STEPS = ((0.001, 20), (0.0005, 40), (0.00025, 80))
SPEEDS = {"bp2": (3.0, 6.0, 9.0, 12.0), "go1": (1.5, 3.0, 4.5, 6.0), "go2": (1.5, 2.5, 3.5, 5.0)}
HOLD, LAST, PERIOD = 5.0, 3.0, 0.02
COPIES, TRIALS = 4, 2
FINER = 10
NAMES = ("speed [m/s]", "stride [Hz]", "power [W]", "foot force [body weights]")


def smooth(place: np.ndarray, velocity: np.ndarray) -> np.ndarray:
    """Joint positions ``FINER`` times as often: cubics through positions and velocities of policy steps."""
    t = (np.arange(FINER) / FINER)[None, :, None]
    before, after, v, w = (values[:, None] for values in (place[:-1], place[1:], velocity[:-1], velocity[1:]))
    bend = PERIOD * (v * t * (1 - t) ** 2 - w * t**2 * (1 - t))
    cubic = before + (after - before) * t**2 * (3 - 2 * t) + bend
    return cubic.reshape(-1, place.shape[1])


class Runners:
    """Robots of one engine, each with its own profile and runtime."""

    def __init__(self, policy_path: Path, robot: RobotDescription, timestep: float, substeps: int) -> None:
        self.profiles = [
            SpeedProfile(top_speed=v, hold=HOLD) for v in SPEEDS[robot.name] for _ in range(COPIES)
        ]
        n = len(self.profiles)
        self.engine = Engine(robot, EngineOptions(robots=n, timestep=timestep, substeps=substeps), "cpu")
        joints = [self.engine.mj_model.joint(name) for name in robot.joint_names]
        self.places = [int(joint.qposadr[0]) for joint in joints]
        self.rates = [int(joint.dofadr[0]) for joint in joints]
        for row in range(n):
            draw = np.random.default_rng(row % COPIES).uniform(-JOINT_NOISE, JOINT_NOISE, len(joints))
            self.engine.qpos[row, self.places] += torch.tensor(draw, dtype=torch.float32)
        policy = load_policy(policy_path, robot)
        self.runtimes = [PolicyRuntime(policy, robot) for _ in range(n)]
        self.weight = self.engine.weight.numpy()

    def step(self, time: float) -> None:
        """One policy step of all."""
        qpos, qvel = self.engine.qpos.double().numpy(), self.engine.qvel.double().numpy()
        for row, (runtime, profile) in enumerate(zip(self.runtimes, self.profiles, strict=True)):
            w, x, y, z = qpos[row, 3:7]
            heading = np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
            speed = float(profile.command(min(time, profile.duration)))
            turn = float(heading_command(heading, qpos[row, 1], speed))
            measured = Measurement(
                angular_velocity=qvel[row, 3:6],
                projected_gravity=np.asarray(projected_gravity(qpos[row, 3:7])),
                joint_position=qpos[row, self.places],
                joint_velocity=qvel[row, self.rates],
            )
            targets = runtime.step(measured, np.array([speed, 0.0, turn]))
            self.engine.target[row] = torch.tensor(np.asarray(targets, dtype=np.float32))
        self.engine.step()

    def run(self) -> list[tuple[float, ...]]:
        """The four numbers of every robot; NaN for one that fell."""
        longest = max(profile.duration for profile in self.profiles)
        rows: list[list[np.ndarray]] = []
        for index in range(round(longest / PERIOD)):
            self.step(index * PERIOD)
            e = self.engine
            rows.append(
                [
                    e.qpos.double().numpy().copy(),
                    e.qvel.double().numpy().copy(),
                    e.power.numpy().copy(),
                    e.foot_force.numpy().copy(),
                ]
            )
        return [self._numbers(row, rows) for row in range(len(self.profiles))]

    def _numbers(self, row: int, steps: list[list[np.ndarray]]) -> tuple[float, ...]:
        end = round(self.profiles[row].hold_interval[1] / PERIOD)
        hold = steps[end - round(LAST / PERIOD) : end]
        place, velocity, power, force = (np.array([step[k][row] for step in hold]) for k in range(4))
        if (place[:, 2] < 0.5 * self.engine.robot.standing_height).any():
            return (float("nan"),) * 4
        speed = (place[-1, 0] - place[0, 0]) / (LAST - PERIOD)
        return (
            float(speed),
            stride_frequency(smooth(place[:, self.places], velocity[:, self.rates]), PERIOD / FINER),
            float(power.mean()),
            float(force.max()),
        )


def in_plant(policy_path: Path, robot: RobotDescription, speed: float, seed: int) -> tuple[float, ...]:
    """The same numbers from the plant."""
    settings = TrialSettings(seed=seed, joint_noise=JOINT_NOISE)
    request = TrialRequest(top_speed=speed, hold=HOLD, settings=settings, keep_trajectory=True)
    result = run_trial(load_policy(policy_path, robot), robot, request)
    moved = result.trajectory
    assert moved is not None and moved.bus_power is not None and moved.foot_impact is not None
    end = result.hold_interval[1]
    hold = (moved.time > end - LAST) & (moved.time <= end)
    if not hold.any() or moved.time[-1] < end:
        return (float("nan"),) * 4
    time = moved.time[hold]
    return (
        (moved.qpos[hold][-1, 0] - moved.qpos[hold][0, 0]) / (time[-1] - time[0]),
        stride_frequency(moved.joint_position[hold], time[1] - time[0]),
        moved.bus_power[hold].mean(),
        moved.foot_impact[hold].max() / (robot.total_mass * GRAVITY),
    )


def compare(path: Path, robot: RobotDescription) -> dict[str, dict[str, dict[str, float]]]:
    """Median and half of the spread of the plant's trials, and the engine's median at every time step."""
    speeds = SPEEDS[robot.name]
    found = {
        "plant": np.array(
            [[in_plant(path, robot, speed, seed) for seed in range(TRIALS)] for speed in speeds]
        )
    }
    for timestep, substeps in STEPS:
        rows = Runners(path, robot, timestep, substeps).run()
        found[f"{timestep:g} s"] = np.array(rows).reshape(len(speeds), COPIES, len(NAMES))
    means = {name: np.median(values, axis=1) for name, values in found.items()}
    means["plant spread"] = 0.5 * np.ptp(found["plant"], axis=1)
    for name, values in means.items():
        print(robot.name, name, np.round(values / means["plant"], 3).tolist(), flush=True)
    return {
        name: {
            f"{speed:g}": dict(zip(NAMES, row, strict=True))
            for speed, row in zip(speeds, values.tolist(), strict=True)
        }
        for name, values in means.items()
    }


def main() -> None:
    """Compare and write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--output", type=Path, required=True)
    output = parser.parse_args().output
    robots = {"sprint": "bp2", "go1-sprint": "go1", "go2-sprint": "go2"}
    result = {name: compare(path, load_robot(robots[name])) for name, path in shipped_policies().items()}
    output.write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
