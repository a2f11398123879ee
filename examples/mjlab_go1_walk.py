"""mjlab's Go1 walks by a public policy: on mjlab's position actuators, its DC motors, refined motors.

    pip install 'sprintlab[mjlab]'
    python examples/mjlab_go1_walk.py go1_policy.onnx --figure walk.png

The policy is `go1_policy.onnx` of MuJoCo Playground (`experimental/sim2sim/onnx`, Apache 2.0), which mjlab
had in its own `scripts` when it began; its gains, action scale and rates are used, on mjlab's robot with
mjlab's torque and speed limits. Our motors are those of the table of `go1`. Each commanded speed has an
environment of its own, on the CPU.
"""

from __future__ import annotations

import argparse
import json
import os
from pathlib import Path

import numpy as np
import onnxruntime
import torch
import warp as wp
from mjlab.actuator import ActuatorCfg, BuiltinPositionActuatorCfg, DcMotorActuatorCfg
from mjlab.asset_zoo.robots.unitree_go1 import go1_constants as go1
from mjlab.entity import Entity, EntityArticulationInfoCfg
from mjlab.scene import Scene, SceneCfg
from mjlab.sim import MujocoCfg, Simulation, SimulationCfg
from mjlab.terrains import TerrainEntityCfg
from numpy.typing import NDArray
from torque_over_speed import Drives, FloatArray, Walk, draw, impossible_share, table_drives, walked

from sprintlab.integrations.mjlab import PmsmActuatorCfg
from sprintlab.robots import RobotDescription, load_robot, robot_motors

PARTS = {"hip": "abad", "thigh": "hip", "calf": "knee"}  # the model's names of a leg's joints, the table's
HOME = {"hip": 0.0, "thigh": 0.9, "calf": -1.8}  # [rad]
GROUPS = (
    ((".*_hip_joint", ".*_thigh_joint"), go1.HIP_ACTUATOR),
    ((".*_calf_joint",), go1.KNEE_ACTUATOR),
)
STIFFNESS, DAMPING = 35.0, 0.5  # [N m/rad], [N m s/rad]
ACTION_SCALE, POLICY_PERIOD, TIMESTEP = 0.5, 0.02, 0.004  # [rad], [s], [s]
LAWS = ("position", "dc_motor", "refined")


def actuators(law: str, robot: RobotDescription) -> tuple[ActuatorCfg, ...]:
    """The policy's PD loop on both kinds of joints, behind one of the laws."""
    found: list[ActuatorCfg] = []
    for joints, limit in GROUPS:
        own = {
            "target_names_expr": joints,
            "stiffness": STIFFNESS,
            "damping": DAMPING,
            "armature": limit.reflected_inertia,
        }
        if law == "refined":
            found.append(PmsmActuatorCfg(**own, motors=robot_motors(robot)))
        elif law == "dc_motor":
            peak, top = limit.effort_limit, limit.velocity_limit
            found.append(
                DcMotorActuatorCfg(**own, effort_limit=peak, saturation_effort=peak, velocity_limit=top)
            )
        else:
            found.append(BuiltinPositionActuatorCfg(**own, effort_limit=limit.effort_limit))
    return tuple(found)


def build(law: str, robot: RobotDescription, environments: int) -> tuple[Scene, Simulation]:
    """mjlab's Go1 on flat ground, in its scene and its simulation, on the CPU."""
    configuration = go1.get_go1_robot_cfg()
    configuration.articulation = EntityArticulationInfoCfg(actuators=actuators(law, robot))
    terrain = TerrainEntityCfg(terrain_type="plane")
    scene = Scene(SceneCfg(num_envs=environments, terrain=terrain, entities={"robot": configuration}), "cpu")
    settings = SimulationCfg(mujoco=MujocoCfg(timestep=TIMESTEP, iterations=10, ls_iterations=20))
    simulation = Simulation(environments, settings, scene.compile(), "cpu")
    scene.initialize(simulation.mj_model, simulation.model, simulation.data)
    scene.reset()
    return scene, simulation


def observation(
    entity: Entity, home: torch.Tensor, action: FloatArray, commands: FloatArray
) -> NDArray[np.float32]:
    """What the policy sees, ``(environments, 48)``."""
    data = entity.data
    parts = (
        data.root_link_lin_vel_b,
        data.root_link_ang_vel_b,
        data.projected_gravity_b,
        data.joint_pos - home,
        data.joint_vel,
    )
    still = np.zeros((len(commands), 2))
    measured = [part.numpy() for part in parts]
    return np.hstack([*measured, action, commands[:, None], still]).astype(np.float32)


def walks(
    law: str, robot: RobotDescription, policy: Path, commands: FloatArray, duration: float = 4.0
) -> list[Walk]:
    """One walk for each commanded speed [m/s], side by side; the joints stand as the policy has them."""
    scene, simulation = build(law, robot, len(commands))
    entity: Entity = scene["robot"]
    kinds = [name.split("_")[1] for name in entity.joint_names]
    home = torch.tensor([[HOME[kind] for kind in kinds]]).repeat(len(commands), 1)
    entity.write_joint_state_to_sim(home, torch.zeros_like(home))
    session = onnxruntime.InferenceSession(str(policy), providers=["CPUExecutionProvider"])
    action, samples = np.zeros((len(commands), len(kinds))), []
    for _ in range(round(duration / POLICY_PERIOD)):
        simulation.forward()
        seen = observation(entity, home, action, commands)
        action = np.vstack([np.asarray(session.run(None, {"obs": one[None]})[0]) for one in seen])
        target = home + ACTION_SCALE * torch.tensor(action, dtype=torch.float)
        for _ in range(round(POLICY_PERIOD / TIMESTEP)):
            samples.append(advance(scene, simulation, target))
    trunk, speed, asked, delivered = (np.array(values, dtype=float) for values in zip(*samples, strict=True))
    return [
        walked(trunk[:, i], speed[:, i], asked[:, i], delivered[:, i], TIMESTEP) for i in range(len(commands))
    ]


def advance(scene: Scene, simulation: Simulation, target: torch.Tensor) -> tuple[FloatArray, ...]:
    """One step of physics: where the trunk was, speeds, torques asked and delivered."""
    entity: Entity = scene["robot"]
    position, speed = entity.data.joint_pos.clone(), entity.data.joint_vel.clone()
    trunk = entity.data.root_link_pos_w.clone()
    entity.set_joint_position_target(target)
    scene.write_data_to_sim()
    simulation.step()
    scene.update(TIMESTEP)
    asked = STIFFNESS * (target - position) - DAMPING * speed
    delivered = simulation.data.qfrc_actuator[:, entity.indexing.joint_v_adr]
    return tuple(value.numpy().copy() for value in (trunk, speed, asked, delivered))


def model_drives(robot: RobotDescription) -> Drives:
    """The table's motors in the order of mjlab's joints."""
    legs = [f"{leg}_{part}" for leg in ("FR", "FL", "RR", "RL") for part in PARTS.values()]
    return table_drives(robot, [robot.joint_names.index(name) for name in legs])


def numbers(
    found: dict[str, list[Walk]], commands: FloatArray, drives: Drives
) -> dict[str, dict[str, float]]:
    """How fast the robot and its calves were, and what the motors could not have done."""
    return {
        f"{law}_{command:g}": {
            "held_m_s": round(one.held, 3),
            "lowest_trunk_m": round(one.lowest, 3),
            "fastest_calf_rad_s": round(float(np.abs(one.speed[:, 2::3]).max()), 1),
            "impossible_work_share": round(impossible_share(one, drives), 3),
        }
        for law, several in found.items()
        for command, one in zip(commands, several, strict=True)
    }


def main() -> None:
    """Walk on each law, print, draw."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("policy", type=Path, help="go1_policy.onnx of MuJoCo Playground")
    parser.add_argument("--commands", type=float, nargs="+", default=[0.5, 1.0, 1.5], help="[m/s]")
    parser.add_argument("--duration", type=float, default=4.0, help="of a walk [s]")
    parser.add_argument("--figure", type=Path, help="torque over speed at the last command, PNG, PDF or SVG")
    parser.add_argument("--json", action="store_true", help="print JSON only")
    given = parser.parse_args()
    wp.config.log_level = wp.LOG_WARNING
    robot, commands = load_robot("go1"), np.array(given.commands)
    found = {law: walks(law, robot, given.policy, commands, given.duration) for law in LAWS}
    drives = model_drives(robot)
    table = numbers(found, commands, drives)
    if given.figure is not None:
        last = {f"{law.replace('_', ' ')}, {given.commands[-1]:g} m/s": found[law][-1] for law in LAWS}
        draw(given.figure, {"thigh": range(1, 12, 3), "calf": range(2, 12, 3)}, last, drives)
    print(json.dumps(table) if given.json else "\n".join(f"{name}: {row}" for name, row in table.items()))


if __name__ == "__main__":
    os.environ.setdefault("MUJOCO_GL", "disabled")
    main()
