"""The engine against references: accelerations of MuJoCo, and rebounds of an articulated leg.

python benchmarks/engine_accuracy.py --output results/engine/accuracy.json
"""

from __future__ import annotations

import argparse
import json
import shlex
import sys
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import mujoco
import numpy as np
import torch

from sprintlab.core.array_types import FloatArray
from sprintlab.engine import Engine, EngineOptions
from sprintlab.engine.source import EngineModel
from sprintlab.plant import PadLaw, Pads
from sprintlab.robots import FootContact, RobotDescription, load_robot, robot_names

STATES = 1000
PADS = [(k, e) for k in (40e3, 80e3, 160e3) for e in (0.2, 0.4, 0.6)]
"""Stiffness [N/m] and restitution of the pads that are dropped on: the band of what no maker states."""
SPEEDS, ALONG, FRICTION = (2.0, 4.0), 6.0, 0.8
PHASES = (np.arange(4) + 0.5) / 4
"""Shares of a time step between start and touchdown."""
FINE = 2e-5
"""Time step of the reference [s]."""
_FLIGHT = 0.002  # between the start and the touchdown [s]
_LONGEST = 0.04  # longest time of a drop [s]


def acceleration_error(name: str, states: int = STATES) -> float:
    """Greatest deviation from ``mj_forward`` over a state's greatest acceleration, single precision."""
    step, draw = 1e-5, np.random.default_rng(1)
    options = EngineOptions(robots=states, substeps=1, timestep=step)
    engine = Engine(load_robot(name), options, "cpu", given_torque=True)
    engine.drag_area.zero_()
    place = engine.qpos.double().numpy().copy()
    place[:, 2] = 5.0
    place[:, 3:7] += draw.normal(0, 0.3, (states, 4))
    place[:, 3:7] /= np.linalg.norm(place[:, 3:7], axis=1)[:, None]
    place[:, 7:] += draw.uniform(-0.5, 0.5, (states, place.shape[1] - 7))
    engine.qpos.copy_(torch.tensor(place))
    engine.qvel.copy_(torch.tensor(draw.normal(0, 4, engine.qvel.shape)))
    engine.given_torque.copy_(torch.tensor(draw.normal(0, 30, engine.qvel.shape)))
    place, speed = engine.qpos.double().numpy().copy(), engine.qvel.double().numpy().copy()
    engine.step()
    model = engine.mj_model
    data, inertia, worst = mujoco.MjData(model), np.zeros((model.nv, model.nv)), 0.0
    for row in range(states):
        data.qpos, data.qvel = place[row], speed[row]
        data.qfrc_applied[6:] = engine.given_torque[row, 6:].numpy()
        mujoco.mj_forward(model, data)
        mujoco.mj_fullM(model, data, inertia)
        damped = inertia + 0.5 * step * np.diag(model.dof_damping)  # friction of the step's middle
        expected = np.linalg.solve(damped, inertia @ data.qacc)
        worst = max(worst, float(np.abs(engine.qacc[row].numpy() - expected).max() / np.abs(expected).max()))
    return worst


def dropped_robot() -> RobotDescription:
    """BP2 with joints without friction."""
    robot = load_robot("bp2")
    joints = np.zeros(len(robot.joint_names))
    return replace(robot, dry_friction=joints, viscous_friction=joints)


def dropped(robots: int, step: float) -> Engine:
    """Robots with rigid knees, as ``effective_leg_mass`` takes them, without motors, gravity and air."""
    options = EngineOptions(robots=robots, timestep=step, substeps=1, knee_spring=False)
    engine = Engine(dropped_robot(), options, "cpu")
    for name in ("stiffness", "damping", "gravity", "drag_area"):
        getattr(engine, name).zero_()
    return engine


def drops() -> list[tuple[float, float, float, float]]:
    """Stiffness, restitution, speed and phase of each drop."""
    return [(k, e, speed, phase) for k, e in PADS for speed in SPEEDS for phase in PHASES]


def start(model: mujoco.MjModel, down: float, flight: float) -> tuple[FloatArray, FloatArray]:
    """The robot falls as a whole, three legs bent out of the way, one foot just over the ground."""
    place, speed = model.key("stand").qpos.copy(), np.zeros(model.nv)
    for leg in range(1, 4):
        place[8 + 3 * leg : 10 + 3 * leg] += (0.3, -0.6)
    place[2] += down * flight
    speed[2] = -down
    return place, speed


def engine_rebounds(step: float, along: float, friction: float) -> FloatArray:
    """Speed of the foot's lift-off over that of its landing, for each of ``drops()``."""
    cases = drops()
    engine = dropped(len(cases), step)
    engine.friction.fill_(friction)
    table = torch.tensor(cases)
    engine.draw_pads(table[:, 0], table[:, 1])
    for row, (_, _, down, phase) in enumerate(cases):
        place, speed = start(engine.mj_model, down, (round(_FLIGHT / step) + phase) * step)
        engine.qpos[row], engine.qvel[row] = torch.tensor(place), torch.tensor(speed)
    engine.qvel[:, 0] = along
    rebound, landed, left = torch.zeros(len(cases)), *torch.zeros(2, len(cases), dtype=torch.bool)
    for _ in range(round(_LONGEST / step)):
        engine.step()
        pressed = engine.contact_force[:, 0, 2] > 0.0  # the last such step ends in flight
        landed |= pressed
        left |= landed & ~pressed
        rebound = torch.where(pressed & ~left, engine.foot_velocity[:, 0, 2], rebound)
    return (rebound / table[:, 2]).double().numpy()


def reference_rebounds(along: float, friction: float) -> FloatArray:
    """The same from MuJoCo with the plant's pad at a fine time step."""
    engine = dropped(1, 0.0005).model
    laws = [PadLaw.of(FootContact(stiffness=k, restitution=e), engine.leg_mass) for k, e in PADS]
    found = [_reference(engine, law, (down, along, friction)) for law in laws for down in SPEEDS]
    return np.repeat(found, len(PHASES))


def _reference(engine: EngineModel, law: PadLaw, case: tuple[float, float, float]) -> float:
    (down, along, friction), model = case, engine.model
    model.opt.timestep, model.opt.gravity = FINE, 0.0
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    data = mujoco.MjData(model)
    data.qpos, data.qvel = start(model, down, 10.5 * FINE)
    data.qvel[0] = along
    pads = Pads(model, data, [f"{leg}_foot" for leg in engine.robot.leg_names], law, friction)
    velocity, foot, landed = np.zeros(6), model.geom(f"{engine.robot.leg_names[0]}_foot").id, False
    for _ in range(round(_LONGEST / FINE)):
        mujoco.mj_step1(model, data)
        pads.press()
        if landed and pads.normal_force[0] == 0.0:
            mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_GEOM, foot, velocity, 0)
            return float(velocity[5]) / down
        landed = landed or pads.normal_force[0] > 0.0
        mujoco.mj_step2(model, data)
    raise RuntimeError("the foot does not lift off")


def rebounds(step: float, along: float, friction: float) -> dict[str, float]:
    """Greatest deviation of the rebound from MuJoCo's at a fine step, and from the pad's restitution."""
    ours, theirs = engine_rebounds(step, along, friction), reference_rebounds(along, friction)
    stated = np.array([case[1] for case in drops()])
    return {
        "deviation from fine steps": float(np.abs(ours / theirs - 1.0).max()),
        "deviation from the pad's restitution": float(np.abs(ours / stated - 1.0).max()),
    }


CASES = {"vertical, without friction": (0.0, 0.0), "vertical": (0.0, FRICTION), "slipping": (ALONG, FRICTION)}
"""Speed along the ground [m/s] and friction coefficient."""


def main() -> None:
    """Measure and write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--output", type=Path, required=True)
    chosen = parser.parse_args()
    result = {
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        "command": shlex.join([Path(sys.argv[0]).name, *sys.argv[1:]]),
        "acceleration": {name: acceleration_error(name) for name in robot_names()},
        "rebound": {
            f"{1e3 * step:g} ms": {name: rebounds(step, *case) for name, case in CASES.items()}
            for step in (0.001, 0.0005, 0.00025)
        },
    }
    chosen.output.write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")
    print(json.dumps(result, indent=1))


if __name__ == "__main__":
    main()
