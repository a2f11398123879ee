"""Isaac Lab's actuator: against Isaac Lab 3 where it is installed, else a double with its signatures.

The double repeats the constructor of ``ActuatorBase`` and the order of work of ``IdealPDActuator`` of Isaac
Lab 3.0.0, whose ``compute`` hands the joint velocity to ``_clip_effort``.
"""

from dataclasses import dataclass, field
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest

from sprintlab.core.errors import InvalidValueError
from sprintlab.motors import drive_torque
from sprintlab.robots import robot_motors

torch = pytest.importorskip("torch", reason="needs PyTorch: pip install 'sprintlab[train]'")

LEGS, KINDS = ("FL", "FR", "RL", "RR"), ("hip", "thigh", "calf")
TYPE_MAJOR = [f"{leg}_{kind}_joint" for kind in KINDS for leg in LEGS]


class IdealPDActuator:
    def __init__(self, cfg, joint_names, joint_ids, num_envs, device, **limits):
        self.cfg, self._joint_names = cfg, joint_names
        self.computed_effort = torch.zeros(num_envs, len(joint_names), device=device)
        self.applied_effort = torch.zeros_like(self.computed_effort)
        self.stiffness = torch.full_like(self.computed_effort, cfg.stiffness)
        self.damping = torch.full_like(self.computed_effort, cfg.damping)

    def compute(self, control_action, joint_pos, joint_vel):
        error_pos = control_action.joint_positions - joint_pos
        error_vel = control_action.joint_velocities - joint_vel
        wanted = self.stiffness * error_pos + self.damping * error_vel
        self.computed_effort = wanted + control_action.joint_efforts
        self.applied_effort = self._clip_effort(self.computed_effort, joint_vel)
        control_action.joint_efforts = self.applied_effort
        control_action.joint_positions = control_action.joint_velocities = None
        return control_action


@dataclass
class ActuatorBaseCfg:
    class_type: type = object
    joint_names_expr: list = field(default_factory=list)
    stiffness: float = 0.0
    damping: float = 0.0
    armature: dict | None = None
    actuator_velocity_limit: dict | None = None
    joint_effort_limit: dict | None = None


def configclass(cls):
    """As Isaac Lab's: a dataclass whose fields need no order."""
    return dataclass(kw_only=True)(cls)


@pytest.fixture
def stage(on_guest):
    """The module, on Isaac Lab's own classes or on the doubles."""
    actuators, utilities = ModuleType("isaaclab.actuators"), ModuleType("isaaclab.utils")
    actuators.IdealPDActuator, actuators.ActuatorBaseCfg = IdealPDActuator, ActuatorBaseCfg
    utilities.configclass = configclass
    doubles = {module.__name__: module for module in (ModuleType("isaaclab"), actuators, utilities)}
    return on_guest("isaaclab", "isaaclab.actuators", doubles)


def built(stage, names, motors, **changes):
    cfg = stage.pmsm_actuator(names, motors, stiffness=25.0, damping=0.5, **changes)
    return cfg.class_type(cfg, list(names), slice(None), 5, "cpu")


def driven(actuator, seed=0):
    """Random targets through the actuator: wanted and given torque, joint speed ``(5, n)``."""
    random, joints = np.random.default_rng(seed), actuator.computed_effort.shape[1]
    position, target, speed = (
        torch.tensor(random.normal(0.0, scale, (5, joints)), dtype=torch.float32)
        for scale in (1.0, 2.0, 12.0)
    )
    action = SimpleNamespace(
        joint_positions=target, joint_velocities=torch.zeros(5, joints), joint_efforts=torch.zeros(5, joints)
    )
    done = actuator.compute(action, position, speed)
    assert done is action and done.joint_positions is None
    assert torch.equal(done.joint_efforts, actuator.applied_effort)
    return actuator.computed_effort, actuator.applied_effort, speed


@pytest.mark.parametrize("model", ["refined", "simplified-dc"])
def test_the_actuator_gives_the_law_of_each_joints_motor(stage, model):
    """In Isaac Lab's order, type by type, with calves of another gear than hips and thighs."""
    motors = robot_motors("go1")
    actuator = built(stage, TYPE_MAJOR, motors, motor_model=model)
    wanted, given, speed = driven(actuator)
    order = [3 * leg + kind for kind in range(3) for leg in range(4)]
    back = np.argsort(order)
    expected = drive_torque(
        motors.motor, motors.gear, wanted.numpy()[:, back], speed.numpy()[:, back], motors.bus_voltage, model
    ).torque[:, order]
    assert given.numpy() == pytest.approx(expected, rel=1e-4, abs=1e-3)
    assert given.shape == (5, 12) and given.dtype == torch.float32
    assert not np.allclose(given, wanted)
    actuator.parameters["bus_voltage"][2] *= 0.5
    changed = (given != driven(actuator)[1]).any(dim=1)
    assert changed.tolist() == [False, False, True, False, False]


def test_the_configuration_holds_what_follows_from_the_motors(stage):
    robot = robot_motors("go1")
    cfg = stage.pmsm_actuator(TYPE_MAJOR, robot, stiffness=25.0, damping=0.5)
    assert cfg.armature["RL_calf_joint"] == pytest.approx(
        float(robot.motor.rotor_inertia[8] * robot.gear.ratio[8] ** 2)
    )
    assert cfg.joint_effort_limit["FL_hip_joint"] > float(robot.motor.peak_torque[0] * robot.gear.ratio[0])
    with pytest.raises(InvalidValueError, match="tail"):
        stage.pmsm_actuator(("tail",), robot, stiffness=25.0, damping=0.5)
