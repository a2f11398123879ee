"""Newton's ANYmal C walks by Newton's own policy: on its peak torque, on a straight line, on refined motors.

    pip install 'newton[sim]==1.8.*' gitpython onnxruntime
    python examples/newton_anymal_walk.py --figure walk.png

The robot and the policy are those of Newton's example `robot_anymal_c_walk`, with its gains, armature and
friction; Newton downloads them, or `--assets` names the folder `anybotics_anymal_c` of newton-assets.
Newton's actuators drive the joints at 1 kHz.

The motors of its drives are not published. Ours have the straight line that Isaac Lab gives them (120 N m at
standstill, 80 N m at most, nothing at 7.5 rad/s), and at no load the reactance over resistance of a motor of
the MIT Humanoid. The joint's envelope does not depend on gear ratio, pole pairs and bus voltage then.
"""

from __future__ import annotations

import argparse
import json
import math
import xml.etree.ElementTree as ElementTree
from pathlib import Path
from typing import Any

import newton
import numpy as np
import onnxruntime
import warp as wp
from newton.actuators import ClampingDCMotor, ClampingMaxEffort, DrivePD
from numpy.typing import NDArray
from torque_over_speed import Drives, FloatArray, Walk, draw, impossible_share, walked

from sprintlab.integrations.newton import pmsm_clampings
from sprintlab.motors import (
    Gear,
    PmsmParameters,
    library_motors,
    load_library_motor,
    no_load_speed,
    phase_voltage_limit,
    stack_motors,
)
from sprintlab.robots import JointMotors

URDF = "urdf/anymal.urdf"
POLICY = "rl_policies/anymal_walking_policy_physx.onnx"
PARTS = ("HAA", "HFE", "KFE")
POLICY_ORDER = [f"{leg}_{part}" for part in PARTS for leg in ("LF", "LH", "RF", "RH")]
POSE = {"HAA": 0.0, "F_HFE": 0.4, "H_HFE": -0.4, "F_KFE": -0.8, "H_KFE": 0.8}  # [rad]
STIFFNESS, DAMPING, ARMATURE = 150.0, 5.0, 0.06  # [N m/rad], [N m s/rad], [kg m^2]
ACTION_SCALE, POLICY_PERIOD, TIMESTEP = 0.5, 0.02, 0.001  # [rad], [s], [s]
STANDSTILL, PEAK, NO_LOAD = 120.0, 80.0, 7.5  # [N m], [N m], [rad/s]: Isaac Lab's ANYDRIVE_3_SIMPLE
GEAR, BUS_VOLTAGE = Gear(ratio=50.0, efficiency=1.0), 48.0  # [V]

Clamping = tuple[type, dict[str, Any]]


def drive_motor(published: str = "mit-humanoid-u12") -> PmsmParameters:
    """A motor on Isaac Lab's straight line, with the reactance over resistance of a published motor."""
    other = load_library_motor(published)
    fastest = other.motor.pole_pairs * no_load_speed(other.motor, other.bus_voltage)
    reactance = float(fastest * other.motor.q_axis_inductance / other.motor.stator_resistance)
    voltage, pole_pairs = phase_voltage_limit(BUS_VOLTAGE), 21
    electrical = pole_pairs * NO_LOAD * GEAR.ratio
    flux = voltage / electrical
    resistance = 1.5 * pole_pairs * flux * voltage / (STANDSTILL / GEAR.ratio)
    return PmsmParameters(
        pole_pairs=pole_pairs,
        stator_resistance=resistance,
        q_axis_inductance=reactance * resistance / electrical,
        flux_linkage=flux,
        peak_torque=PEAK / GEAR.ratio,
        rotor_inertia=ARMATURE / GEAR.ratio**2,
    )


def all_drives(motor: PmsmParameters) -> Drives:
    """That motor on every joint."""
    joints = len(POLICY_ORDER)
    gear = Gear(ratio=np.full(joints, GEAR.ratio), efficiency=np.full(joints, GEAR.efficiency))
    return Drives(stack_motors([motor] * joints), gear, BUS_VOLTAGE)


def clampings(motor: PmsmParameters) -> dict[str, Clamping]:
    """Newton's two laws and ours."""
    line = {"saturation_effort": STANDSTILL, "velocity_limit": NO_LOAD, "max_motor_effort": PEAK}
    motors = JointMotors(motor=motor, gear=GEAR, bus_voltage=BUS_VOLTAGE)
    return {
        "peak_torque": (ClampingMaxEffort, {"max_effort": PEAK}),
        "straight_line": (ClampingDCMotor, line),
        "refined": pmsm_clampings(["any"], motors)["any"],
    }


def bare_urdf(path: Path) -> str:
    """The robot without what only cameras need: the meshes.

    Raises:
        OSError: the file cannot be read.
    """
    tree = ElementTree.parse(path)
    for link in tree.iter("link"):
        for shown in [*link.findall("visual"), *link.findall("self_filter")]:
            link.remove(shown)
    return ElementTree.tostring(tree.getroot(), encoding="unicode")


def build(urdf: str, clamping: Clamping) -> tuple[Any, list[str]]:
    """The robot on the ground, each joint driven by a PD loop behind this law; the names of its joints."""
    builder = newton.ModelBuilder()
    newton.solvers.SolverMuJoCo.register_custom_attributes(builder)
    builder.default_joint_cfg = newton.ModelBuilder.JointDofConfig(
        armature=ARMATURE, limit_ke=1e3, limit_kd=10.0
    )
    shape = builder.default_shape_cfg
    shape.ke, shape.kd, shape.kf, shape.mu = 5e4, 5e2, 1e3, 0.75
    start = wp.transform(wp.vec3(0.0, 0.0, 0.62), wp.quat_identity())
    builder.add_urdf(
        urdf, xform=start, floating=True, enable_self_collisions=False, collapse_fixed_joints=True
    )
    builder.add_ground_plane()
    labels = [label.split("/")[-1] for label in builder.joint_label]
    names = [name for name in labels if name.endswith(PARTS)]
    for name in names:
        joint = labels.index(name)
        place, dof = builder.joint_q_start[joint], builder.joint_qd_start[joint]
        builder.joint_q[place] = next(angle for end, angle in POSE.items() if name.endswith(end))
        builder.joint_target_ke[dof] = builder.joint_target_kd[dof] = (
            0.0  # the actuator drives, not the solver
        )
        builder.joint_effort_limit[dof] = math.inf  # the actuator limits
        builder.add_actuator(
            DrivePD, index=dof, pos_index=place, kp=STIFFNESS, kd=DAMPING, clamping=[clamping]
        )
    return builder.finalize(device="cpu"), names


def observation(
    position: FloatArray, velocity: FloatArray, order: list[int], home: FloatArray, command: float
) -> NDArray[Any]:
    """What Newton's policy sees but its last action: body velocities, gravity, command, joints ``(36,)``."""

    def in_body(vector: FloatArray) -> Any:
        axis, scalar = -position[3:6], position[6]
        return vector + 2.0 * np.cross(axis, np.cross(axis, vector) + scalar * vector)

    body = [in_body(vector) for vector in (velocity[:3], velocity[3:6], np.array([0.0, 0.0, -1.0]))]
    commands = np.array([command, 0.0, 0.0])
    return np.hstack([*body, commands, (position[7:] - home)[order], velocity[6:][order]])


def walk(urdf: str, policy: Path, clamping: Clamping, command: float = 1.0, duration: float = 6.0) -> Walk:
    """One walk at a commanded speed [m/s]."""
    model, names = build(urdf, clamping)
    solver = newton.solvers.SolverMuJoCo(model, use_mujoco_cpu=True, solver="newton", ls_iterations=50)
    before, after, control = model.state(), model.state(), model.control()
    newton.eval_fk(model, before.joint_q, before.joint_qd, before)
    session = onnxruntime.InferenceSession(str(policy), providers=["CPUExecutionProvider"])
    entrance, order = session.get_inputs()[0].name, [names.index(name) for name in POLICY_ORDER]
    home = before.joint_q.numpy()[7:].astype(float)
    target, action, samples = np.zeros(7 + len(names), np.float32), np.zeros(len(names)), []
    for step in range(round(duration / TIMESTEP)):
        position, velocity = before.joint_q.numpy().astype(float), before.joint_qd.numpy().astype(float)
        if step % round(POLICY_PERIOD / TIMESTEP) == 0:
            seen = np.hstack([observation(position, velocity, order, home, command), action])
            action = np.asarray(session.run(None, {entrance: seen[None].astype(np.float32)})[0])[0]
            target[7:][order] = home[order] + ACTION_SCALE * action
            control.joint_target_q.assign(target)
        control.joint_f.zero_()
        for actuator in model.actuators:
            actuator.step(before, control, dt=TIMESTEP)
        asked = STIFFNESS * (target[7:] - position[7:]) - DAMPING * velocity[6:]
        samples.append((position[:3], velocity[6:], asked, control.joint_f.numpy()[6:].astype(float)))
        solver.step(before, after, control, None, TIMESTEP)
        before, after = after, before
    trunk, speed, asked, delivered = (np.array(values) for values in zip(*samples, strict=True))
    return walked(trunk, speed, asked, delivered, TIMESTEP)


def numbers(walks: dict[str, Walk], drives: Drives) -> dict[str, float]:
    """How fast the robot and its joints were, and what the motors could not have done.

    The last on the straight line also with the reactance of each motor of the library.
    """
    found: dict[str, float] = {}
    for name, one in walks.items():
        found[f"held_{name}_m_s"] = round(one.held, 3)
        found[f"lowest_trunk_{name}_m"] = round(one.lowest, 3)
        found[f"fastest_joint_{name}_rad_s"] = round(float(np.abs(one.speed).max()), 1)
        found[f"impossible_work_share_{name}"] = round(impossible_share(one, drives), 3)
    others = [all_drives(drive_motor(name)) for name in library_motors()]
    shares = [impossible_share(walks["straight_line"], other) for other in others]
    found["impossible_work_share_straight_line_least"] = round(min(shares), 3)
    found["impossible_work_share_straight_line_most"] = round(max(shares), 3)
    return found


def main() -> None:
    """Walk three times, print, draw."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--assets", type=Path, help="folder anybotics_anymal_c; without, Newton downloads it")
    parser.add_argument("--command", type=float, default=1.0, help="commanded speed [m/s]")
    parser.add_argument("--duration", type=float, default=6.0, help="of a walk [s]")
    parser.add_argument("--figure", type=Path, help="torque over speed, PNG, PDF or SVG")
    parser.add_argument("--json", action="store_true", help="print JSON only")
    given = parser.parse_args()
    wp.config.log_level = wp.LOG_WARNING
    assets = given.assets or newton.utils.download_asset("anybotics_anymal_c")
    urdf, motor = bare_urdf(assets / URDF), drive_motor()
    walks = {
        name: walk(urdf, assets / POLICY, law, given.command, given.duration)
        for name, law in clampings(motor).items()
    }
    drives = all_drives(motor)
    found = numbers(walks, drives)
    if given.figure is not None:
        titled = {name.replace("_", " "): one for name, one in walks.items()}
        rows = {"hip flexion": range(1, 12, 3), "knee": range(2, 12, 3)}
        draw(given.figure, rows, titled, drives)
    print(json.dumps(found) if given.json else "\n".join(f"{name}: {value}" for name, value in found.items()))


if __name__ == "__main__":
    main()
