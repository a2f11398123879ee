"""Whether the table's robot is the source's robot: inertia, feet, torques, friction, compared by number."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

from sprintlab.robots.description import FloatArray, RobotDescription
from sprintlab.robots.importing.choices import JointChoice, RobotChoices, find_motor
from sprintlab.robots.importing.fit import FittedRobot
from sprintlab.robots.importing.source import SourceRobot, posed
from sprintlab.robots.importing.table import peak_joint_torque
from sprintlab.robots.model import ModelOptions, robot_spec

_POSES = 20


@dataclass(frozen=True, kw_only=True)
class Check:
    """One comparison: what was compared, the outcome in words, and whether it is as it should be."""

    what: str
    outcome: str
    good: bool


def run_checks(
    source: SourceRobot, fitted: FittedRobot, choices: RobotChoices, robot: RobotDescription
) -> tuple[Check, ...]:
    """Compare the robot that the table describes with the file it came from."""
    inertia, feet = compare_models(source, fitted, robot)
    ranges = "; ".join(f"{joint} {low:.2f} to {high:.2f} rad" for joint, (low, high) in fitted.ranges.items())
    alike = f"lengths and masses differ by at most {fitted.spread:.1%}"
    rows = [
        ("joints", "4 legs of 3 hinges, axes x, y, y", True),
        ("legs alike", alike, fitted.spread < 0.01),
        *(("legs unlike", words, False) for words in fitted.unlike),
        ("mass", f"{robot.total_mass:.3f} kg, trunk {fitted.trunk.mass:.3f} kg", True),
    ]
    if source.corrected:
        words = f"impossible for a body in the source, raised: {', '.join(source.corrected)}"
        rows.append(("link inertias", words, False))
    rows += [
        ("inertia matrix", f"differs by at most {inertia:.2%}", inertia < 0.02),
        ("feet", f"differ by at most {1000.0 * feet:.2f} mm", feet < 0.002),
        ("limits", ranges, True),
        *(row for joint, choice in choices.joints.items() for row in _drive_rows(joint, choice, fitted)),
        _sign_row(fitted),
    ]
    return tuple(Check(what=what, outcome=outcome, good=good) for what, outcome, good in rows)


def _drive_rows(joint: str, choice: JointChoice, fitted: FittedRobot) -> list[tuple[str, str, bool]]:
    """Peak torque against the effort limit that the source states, rotor inertia against its armature."""
    motor, effort, armature = find_motor(choice.motor), fitted.efforts[joint], fitted.armature[joint]
    torque, reflected = peak_joint_torque(choice, motor), choice.gear_ratio**2 * float(motor.rotor_inertia)
    words, good = f"{torque:.1f} N m", True
    if effort is not None:
        words, good = f"{words}, source {effort:.1f}", abs(torque - effort) < 0.15 * effort
    words += f"; rotor {reflected:.4f} kg m^2"
    if armature > 0.0:
        good = good and abs(reflected - armature) < 0.3 * armature
        words = f"{words}, source {armature:.4f}"
    rows = [(f"{joint} drive", words, good)]
    if fitted.viscous_friction[joint] == 0.0 and fitted.dry_friction[joint] == 0.0:
        given = choice.viscous_friction is not None or choice.dry_friction is not None
        words = "given" if given else "none in the source and none given: real joints have some"
        rows.append((f"{joint} friction", words, given))
    return rows


def _sign_row(fitted: FittedRobot) -> tuple[str, str, bool]:
    """Joints whose angles differ from the source's: a robot's driver must convert them."""
    turned = [
        f"{name} = {'-' if item.sign < 0 else ''}{item.source}{item.offset:+.3f} rad"
        for name, item in fitted.maps.items()
        if item.sign < 0 or abs(item.offset) > 1e-3
    ]
    return "joint angles", "; ".join(turned) or "all angles as in the source", not turned


def compare_models(source: SourceRobot, fitted: FittedRobot, robot: RobotDescription) -> tuple[float, float]:
    """Greatest relative difference of the joint-space inertia matrix, and of the feet [m], over random poses.

    The matrix is that of the twelve joints with the base held, without rotors; relative in the Frobenius
    norm.
    """
    options = ModelOptions(knee_spring=False, joint_limits=False, dry_friction=False)
    model = robot_spec(robot, options).compile()
    trunk = int(model.body("trunk").id)
    straight = posed(model, trunk, {})
    our_feet = [straight.geom(f"{leg}_foot").xpos.copy() for leg in robot.leg_names]
    maps = [fitted.maps[name] for name in robot.joint_names]
    by_knee = {leg.joints[2].name: leg.foot for leg in source.legs}
    their_feet = [by_knee[item.source] for item in maps[2::3]]
    ours = _Machine(model, trunk, list(robot.joint_names), our_feet)
    theirs = _Machine(source.model, source.base, [item.source for item in maps], their_feet)
    random = np.random.default_rng(0)
    inertia = distance = 0.0
    for _ in range(_POSES):
        pose = random.uniform(*robot.position_limits.T)
        mapped = [item.sign * (angle - item.offset) for item, angle in zip(maps, pose, strict=True)]
        (our_matrix, our_places), (matrix, places) = ours.state(pose.tolist()), theirs.state(mapped)
        difference = np.linalg.norm(our_matrix - matrix) / np.linalg.norm(matrix)
        inertia = max(inertia, float(difference))
        apart = np.linalg.norm(our_places - (places - fitted.origin), axis=1)
        distance = max(distance, float(apart.max()))
    return inertia, distance


class _Machine:
    """A compiled model with its base held, asked for inertia and feet.

    ``feet`` are the feet's middles in the base frame with all joints at zero.
    """

    def __init__(self, model: mujoco.MjModel, base: int, joints: list[str], feet: list[FloatArray]) -> None:
        self._model, self._base, self._joints = model, base, joints
        data = posed(model, base, {})
        self._shanks = [int(model.joint(name).bodyid[0]) for name in joints[2::3]]
        frame = data.xmat[base].reshape(3, 3)
        self._feet = [
            data.xmat[body].reshape(3, 3).T @ (data.xpos[base] + frame @ foot - data.xpos[body])
            for body, foot in zip(self._shanks, feet, strict=True)
        ]

    def state(self, angles: list[float]) -> tuple[FloatArray, FloatArray]:
        """Inertia matrix of the joints without rotors ``(12, 12)``, and the feet in base frame ``(4, 3)``."""
        model = self._model
        data = posed(model, self._base, dict(zip(self._joints, angles, strict=True)))
        full = np.empty((model.nv, model.nv))
        mujoco.mj_fullM(model, data, full)
        full -= np.diag(model.dof_armature)
        dofs = [int(model.joint(name).dofadr[0]) for name in self._joints]
        frame, origin = data.xmat[self._base].reshape(3, 3), data.xpos[self._base]
        places = [
            frame.T @ (data.xpos[body] + data.xmat[body].reshape(3, 3) @ foot - origin)
            for body, foot in zip(self._shanks, self._feet, strict=True)
        ]
        return full[np.ix_(dofs, dofs)], np.array(places)
