"""What motors, friction, ground and air give to a robot and take from it is what its energy changes by."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from sprintlab.engine import Engine, EngineOptions
from sprintlab.robots import DRAG_AREA, air_drag, load_robot, soft_stop_torque

STEP, DURATION = 0.0005, 2.0


class Ledger:
    """Powers of one robot, from MuJoCo's Jacobians and the torques and forces that the engine reports."""

    def __init__(self, name: str) -> None:
        self.robot = load_robot(name)
        self.engine = Engine(
            self.robot, EngineOptions(robots=1, timestep=STEP, substeps=1), "cpu", double=True
        )
        self.model = self.engine.mj_model
        self.model.opt.enableflags |= mujoco.mjtEnableBit.mjENBL_ENERGY
        self.data = mujoco.MjData(self.model)
        self.joints = [self.model.joint(joint) for joint in self.robot.joint_names]
        self.dofs = [int(joint.dofadr[0]) for joint in self.joints]
        self.places = [int(joint.qposadr[0]) for joint in self.joints]

    def state(self) -> tuple[np.ndarray, np.ndarray]:
        return self.engine.qpos[0].numpy().copy(), self.engine.qvel[0].numpy().copy()

    def energy(self, place: np.ndarray, speed: np.ndarray) -> float:
        self.data.qpos, self.data.qvel = place, speed
        mujoco.mj_fwdPosition(self.model, self.data)
        mujoco.mj_fwdVelocity(self.model, self.data)
        mujoco.mj_energyPos(self.model, self.data)
        mujoco.mj_energyVel(self.model, self.data)
        return float(self.data.energy.sum())

    def powers(self, place: np.ndarray, before: np.ndarray, middle: np.ndarray) -> list[float]:
        """Powers of motors, joints, viscous friction, air and ground in the last step [W]."""
        position, velocity, robot = place[self.places], before[self.dofs], self.robot
        stops = soft_stop_torque(position, velocity, robot.position_limits, robot.soft_stop)
        dry = stops - robot.dry_friction * np.tanh(velocity / 0.2)
        given = self.engine.torque[0].numpy()
        viscous = -float((self.model.dof_damping * middle**2).sum())
        air = float(air_drag(before[:3], DRAG_AREA) @ middle[:3])
        return [
            float(given @ middle[self.dofs]),
            float(dry @ middle[self.dofs]),
            viscous,
            air,
            self.ground(middle),
        ]

    def ground(self, middle: np.ndarray) -> float:
        power, jacobian = 0.0, np.zeros((3, self.model.nv))
        for foot, leg in enumerate(self.robot.leg_names):
            geom = self.model.geom(f"{leg}_foot").id
            point = self.data.geom_xpos[geom] - np.array([0.0, 0.0, self.robot.foot_radius])
            mujoco.mj_jac(self.model, self.data, jacobian, None, point, self.model.geom_bodyid[geom])
            power += float(self.engine.contact_force[0, foot].numpy() @ (jacobian @ middle))
        return power

    def swing(self, time: float) -> None:
        """Hopping on the spot."""
        bend = 0.04 * np.sin(5.0 * np.pi * time)
        for _, hip, knee in self.robot.leg_joints:
            self.engine.target[0, hip] = self.robot.default_pose[hip] + bend
            self.engine.target[0, knee] = self.robot.default_pose[knee] - 2.0 * bend


@pytest.mark.parametrize("name", ["bp2", "go1"])
def test_energy_closes(name: str) -> None:
    ledger = Ledger(name)
    change, flows, throughput = 0.0, [], 0.0
    steps = round(DURATION / STEP)
    for step in range(steps):
        ledger.swing(step * STEP)
        place, before = ledger.state()
        ledger.engine.step()
        middle = 0.5 * (before + ledger.state()[1])
        energy = ledger.energy(place, middle)
        change = change - energy if step == 0 else change
        flows.append(ledger.powers(place, before, middle))
        throughput += STEP * float(np.abs(flows[-1]).sum())
    change += energy
    spent = STEP * float(np.array(flows).sum(1)[1:-1].sum() + 0.5 * (sum(flows[0]) + sum(flows[-1])))
    assert ledger.engine.qpos[0, 2] > 0.5 * ledger.robot.standing_height
    assert abs(change - spent) < 0.001 * throughput
