"""The feet's contact shows the stiffness and restitution that it was given."""

import math

import mujoco
import numpy as np
import pytest

from sprintlab.core.errors import InvalidValueError
from sprintlab.robots import (
    AIR_DENSITY,
    FootContact,
    ModelOptions,
    air_drag,
    build_model,
    effective_leg_mass,
    load_robot,
    set_friction,
)

MASS = 1.2  # of BP2's leg [kg]


def test_damping_is_more_than_for_a_foot_that_sticks_and_near_critical_along_the_ground() -> None:
    """Along the ground a leg weighs a fifth to a half of ``MASS``."""
    foot, sticking = FootContact(), -math.log(0.4) / math.hypot(math.pi, math.log(0.4))
    assert foot.damping_ratio > 1.2 * sticking
    with pytest.raises(InvalidValueError, match=r"foot.restitution"):
        FootContact(restitution=1.0)
    for share in (0.2, 0.5):
        critical = 2.0 * math.sqrt(foot.tangential_stiffness * share * MASS)
        assert 0.7 < foot.tangential_damping(MASS) / critical < 1.2


def test_a_leg_weighs_what_its_drop_says() -> None:
    """Half a millisecond after a push on the foot, the foot's speed tells the inertia behind it."""
    robot = load_robot("bp2")
    rigid = build_model(
        robot, ModelOptions(timestep=1e-5, knee_spring=False, joint_limits=False, dry_friction=False)
    )
    model = build_model(robot)
    rigid.opt.gravity[:] = 0.0
    data = mujoco.MjData(rigid)
    mujoco.mj_resetDataKeyframe(rigid, data, 0)
    data.qpos[2] += 1.0
    mujoco.mj_forward(rigid, data)
    foot = rigid.geom("FL_foot")
    push = np.zeros(rigid.nv)
    mujoco.mj_applyFT(rigid, data, [0, 0, 100.0], [0, 0, 0], data.geom_xpos[foot.id], foot.bodyid[0], push)
    data.qfrc_applied[:] = push
    before = data.geom_xpos[foot.id, 2]
    for _ in range(50):
        mujoco.mj_step(rigid, data)
    mujoco.mj_kinematics(rigid, data)
    moved = data.geom_xpos[foot.id, 2] - before
    assert 0.5 * 100.0 / effective_leg_mass(model) * 0.0005**2 == pytest.approx(moved, rel=0.05)


def test_friction_is_set_where_it_acts() -> None:
    model = build_model(load_robot("bp2"))
    set_friction(model, 0.37)
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    data.qpos[2] -= 0.002
    mujoco.mj_forward(model, data)
    np.testing.assert_allclose([contact.friction[:2] for contact in data.contact], [[0.37, 0.37]] * 4)


def test_air_brakes_with_the_square_of_the_speed() -> None:
    np.testing.assert_allclose(
        air_drag(np.array([3.0, 4.0, 0.0]), 0.2), -0.5 * AIR_DENSITY * np.array([3.0, 4.0, 0.0])
    )
