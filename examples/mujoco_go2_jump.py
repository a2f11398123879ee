"""A jump of MuJoCo Menagerie's Go2 in plain MuJoCo: on its model's motors, `<dcmotor>`s, refined ones.

    python examples/mujoco_go2_jump.py mujoco_menagerie/unitree_go2/go2.xml --figure jump.png

A PD loop crouches, stretches all legs at once and lands. The model's own motors give their peak torque at
every speed. In both runs the joints' damping is that of the table of `go2`: the published model has 2 N m
s/rad, which takes 20 N m of a joint at 10 rad/s, as a stand-in for what the motor law says. Meshes are left
out: only cameras need them.
"""

from __future__ import annotations

import argparse
import json
import re
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import mujoco
import numpy as np
from torque_over_speed import Drives, FloatArray, draw, impossible_share

from sprintlab.integrations.mjcf import dc_motor, motor_callback
from sprintlab.robots import JointMotors, RobotDescription, load_robot, robot_motors

Control = Callable[[FloatArray, FloatArray], FloatArray]

CROUCH = {"hip": 0.0, "thigh": 1.2, "calf": -2.5}  # [rad]
STRETCH = {"hip": 0.0, "thigh": 0.5, "calf": -1.0}
LAND = {"hip": 0.0, "thigh": 0.9, "calf": -1.8}
PHASES = ((0.6, CROUCH), (0.78, STRETCH), (1.5, LAND))  # until when [s]
STIFFNESS, DAMPING = 250.0, 3.0  # [N m/rad], [N m s/rad]


class Jump(NamedTuple):
    """What one jump was; ``n`` steps, joints in the order of the model's actuators."""

    height: float
    """Greatest rise of the trunk above where it stands [m]."""
    speed: FloatArray
    """Velocities of the joints [rad/s] ``(n, joints)``."""
    asked: FloatArray
    """Torque of the PD loop [N m] ``(n, joints)``."""
    delivered: FloatArray
    """On the joints [N m] ``(n, joints)``."""


def load_text(path: Path) -> str:
    """The model's MJCF on a floor and without meshes.

    Raises:
        ValueError: MuJoCo cannot read or compile it.
    """
    spec = mujoco.MjSpec.from_file(str(path))
    for geom in [geom for geom in spec.geoms if geom.type == mujoco.mjtGeom.mjGEOM_MESH]:
        spec.delete(geom)
    for mesh in list(spec.meshes):
        spec.delete(mesh)
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[5.0, 5.0, 0.1])
    spec.option.timestep = 0.001
    spec.compile()
    return spec.to_xml()


def compiled(text: str, robot: RobotDescription) -> mujoco.MjModel:
    """The model with the table's friction."""
    model = mujoco.MjModel.from_xml_string(text)
    model.dof_damping[6:] = robot.viscous_friction[0]
    return model


def drives(model: mujoco.MjModel, robot: RobotDescription) -> Drives:
    """The table's motors and gears in the order of the model's actuators, found by their joints' names."""
    found = robot_motors(robot).ordered([model.joint(joint).name for joint in model.actuator_trnid[:, 0]])
    return Drives(found.motor, found.gear, found.bus_voltage)


def on_dc_motors(text: str, model: mujoco.MjModel, drives: Drives) -> tuple[str, Control]:
    """The same model's MJCF on the `<dcmotor>`s nearest to the motors, and their voltages for wanted torques.

    Their rotors are left out: the model's armature has them.
    """
    found = [dc_motor(*drives.single(index)) for index in range(model.nu)]
    names = [model.joint(joint).name for joint in model.actuator_trnid[:, 0]]
    elements = [replace(element, rotor_inertia=0.0) for element in found]
    lines = "".join(element.element(name) for element, name in zip(elements, names, strict=True))
    other = re.sub("<actuator>.*</actuator>", f"<actuator>{lines}</actuator>", text, flags=re.DOTALL)

    def volts(asked: FloatArray, speed: FloatArray) -> FloatArray:
        parts = zip(elements, asked, speed, strict=True)
        return np.array([element.control(torque, velocity) for element, torque, velocity in parts])

    return other, volts


def jump(
    model: mujoco.MjModel,
    refined: JointMotors | None = None,
    control: Control = lambda asked, speed: asked,
) -> Jump:
    """One jump: on the model's actuators, or on refined motors."""
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    joints = model.actuator_trnid[:, 0]
    places, dofs = model.jnt_qposadr[joints], model.jnt_dofadr[joints]
    parts = [model.joint(joint).name.split("_")[1] for joint in joints]
    poses = [(end, np.array([pose[part] for part in parts])) for end, pose in PHASES]

    def wanted(state: Any) -> FloatArray:
        target = next(pose for end, pose in poses if state.time < end or end == PHASES[-1][0])
        return STIFFNESS * (target - state.qpos[places]) - DAMPING * state.qvel[dofs]

    start, samples = data.qpos[2], []
    with nullcontext() if refined is None else motor_callback(model, wanted, refined):
        while data.time < PHASES[-1][0]:
            asked, speed = wanted(data), data.qvel[dofs].copy()
            if refined is None:
                data.ctrl[:] = control(asked, speed)
            mujoco.mj_step(model, data)
            samples.append((data.qpos[2], speed, asked, data.qfrc_actuator[dofs].copy()))
    height, speed, asked, delivered = (np.array(values) for values in zip(*samples, strict=True))
    return Jump(float(height.max() - start), speed, asked, delivered)


def numbers(jumps: dict[str, Jump]) -> dict[str, float]:
    """How high, and how fast the fastest joint was."""
    rises = {f"rise_{name}_m": round(found.height, 4) for name, found in jumps.items()}
    tops = {name: round(float(np.abs(found.speed).max()), 1) for name, found in jumps.items()}
    return rises | {f"fastest_joint_{name}_rad_s": top for name, top in tops.items()}


def main() -> None:
    """Jump twice, print, draw."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("model", type=Path, help="go2.xml of MuJoCo Menagerie")
    parser.add_argument("--figure", type=Path, help="torque over speed, PNG, PDF or SVG")
    parser.add_argument("--json", action="store_true", help="print JSON only")
    given = parser.parse_args()
    robot = load_robot("go2")
    text = load_text(given.model)
    model = compiled(text, robot)
    motors = drives(model, robot)
    own, refined = jump(model), jump(model, robot_motors(robot))
    dc_text, volts = on_dc_motors(text, model, motors)
    dc_motors = jump(compiled(dc_text, robot), control=volts)
    found = numbers({"own": own, "dcmotor": dc_motors, "refined": refined})
    found["impossible_work_share"] = round(impossible_share(own, motors), 3)
    if given.figure is not None:
        jumps = {"model's own motors": own, "refined motors": refined}
        titled = {f"{name}: jumps {100.0 * one.height:.0f} cm": one for name, one in jumps.items()}
        draw(given.figure, {"thigh": range(1, 12, 3), "calf": range(2, 12, 3)}, titled, motors)
    print(json.dumps(found) if given.json else "\n".join(f"{name}: {value}" for name, value in found.items()))


if __name__ == "__main__":
    main()
