"""How policies run in the engine, against the plant: held speed, stride, power and foot force at four speeds.

python benchmarks/engine_running.py --output engine_running.json

Each policy runs the profile with a hold of five seconds, once in the plant and, with several time steps, in
the engine; numbers are means over the last three seconds of the hold. Two engine robots per speed differ by a
thousandth of a radian in their joints, which shows what chance does.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

import numpy as np
import torch

from sprintlab.commands import SpeedProfile, heading_command
from sprintlab.control import Measurement, PolicyRuntime, load_policy, projected_gravity, shipped_policies
from sprintlab.engine import Engine, EngineOptions
from sprintlab.evaluation.metrics import stride_frequency
from sprintlab.evaluation.trial import TrialRequest, run_trial
from sprintlab.robots import RobotDescription, load_robot

STEPS = ((0.001, 20), (0.0005, 40), (0.00025, 80))
SPEEDS = {"bp2": (3.0, 6.0, 9.0, 12.0), "go1": (1.5, 3.0, 4.5, 6.0), "go2": (1.5, 2.5, 3.5, 5.0)}
HOLD, LAST, PERIOD = 5.0, 3.0, 0.02
COPIES = 2
NAMES = ("speed [m/s]", "stride [Hz]", "power [W]", "foot force [body weights]")


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
        self.engine.qpos[1::2, self.places] += 1e-3
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
                    e.power.numpy().copy(),
                    e.foot_force.numpy().copy(),
                ]
            )
        return [self._numbers(row, rows) for row in range(len(self.profiles))]

    def _numbers(self, row: int, steps: list[list[np.ndarray]]) -> tuple[float, ...]:
        end = round(self.profiles[row].hold_interval[1] / PERIOD)
        hold = steps[end - round(LAST / PERIOD) : end]
        place, power, force = (np.array([step[k][row] for step in hold]) for k in range(3))
        if (place[:, 2] < 0.5 * self.engine.robot.standing_height).any():
            return (float("nan"),) * 4
        speed = (place[-1, 0] - place[0, 0]) / (LAST - PERIOD)
        return (
            float(speed),
            stride_frequency(place[:, self.places], PERIOD),
            float(power.mean()),
            float(force.max()),
        )


def in_plant(policy_path: Path, robot: RobotDescription, speed: float) -> tuple[float, ...]:
    """The same numbers from the plant."""
    request = TrialRequest(top_speed=speed, hold=HOLD, keep_trajectory=True)
    result = run_trial(load_policy(policy_path, robot), robot, request)
    moved = result.trajectory
    assert moved is not None and moved.bus_power is not None and moved.foot_impact is not None
    end = result.hold_interval[1]
    hold = (moved.time > end - LAST) & (moved.time <= end)
    if not hold.any() or moved.time[-1] < end:
        return (float("nan"),) * 4
    time, every = moved.time[hold], round(PERIOD / (moved.time[1] - moved.time[0]))
    weight = robot.total_mass * 9.81
    speed_held = (moved.qpos[hold][-1, 0] - moved.qpos[hold][0, 0]) / (time[-1] - time[0])
    return (
        speed_held,
        stride_frequency(moved.joint_position[hold][::every], PERIOD),
        moved.bus_power[hold].mean(),
        moved.foot_impact[hold].max() / weight,
    )


def compare(
    name: str, path: Path, robot: RobotDescription, known: dict | None
) -> dict[str, dict[str, dict[str, float]]]:
    """Plant and engine at every time step and speed; prints the engine's numbers over the plant's."""
    if known is None:
        plant = {speed: in_plant(path, robot, speed) for speed in SPEEDS[robot.name]}
    else:
        plant = {float(speed): tuple(row.values()) for speed, row in known["plant"].items()}
    result = {"plant": {f"{speed:g}": dict(zip(NAMES, row, strict=True)) for speed, row in plant.items()}}
    for timestep, substeps in STEPS:
        rows = Runners(path, robot, timestep, substeps).run()
        named = result[f"{timestep:g} s"] = {}
        for index, (speed, expected) in enumerate(plant.items()):
            both = np.array(rows[COPIES * index : COPIES * (index + 1)])
            mean, spread = both.mean(0), np.ptp(both, 0)
            named[f"{speed:g}"] = dict(zip(NAMES, mean.tolist(), strict=True))
            ratio = np.round(mean / np.array(expected), 3)
            print(
                name,
                timestep,
                speed,
                np.round(mean, 2),
                "ratio",
                ratio,
                "spread",
                np.round(spread, 2),
                flush=True,
            )
    return result


def main() -> None:
    """Compare and write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--output", type=Path, required=True)
    parser.add_argument("--policy", type=Path, action="append", help="more policies of bp2")
    parser.add_argument("--only", help="a policy's name")
    parser.add_argument("--plant", type=Path, help="an earlier file, whose numbers of the plant are kept")
    arguments = parser.parse_args()
    known = json.loads(arguments.plant.read_text(encoding="utf-8")) if arguments.plant else {}
    robots = {"sprint": "bp2", "go1-sprint": "go1", "go2-sprint": "go2"}
    policies = [(name, path, robots[name]) for name, path in shipped_policies().items()]
    policies += [(path.stem, path, "bp2") for path in arguments.policy or ()]
    result = {
        name: compare(name, path, load_robot(robot), known.get(name))
        for name, path, robot in policies
        if arguments.only in (None, name)
    }
    arguments.output.write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")
    print("wrote", arguments.output, file=sys.stderr)


if __name__ == "__main__":
    main()
