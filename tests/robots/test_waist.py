"""The robot with an active waist: thirteen joints, a trunk of two halves."""

import mujoco
import numpy as np
import pytest

from sprintlab.plant import Plant, PlantOptions, TrialSettings
from sprintlab.robots import ModelOptions, build_model, load_robot
from sprintlab.robots.loader import robot_table_path
from sprintlab.robots.table import read_table

WAIST, BP2 = load_robot("bp2-waist"), load_robot("bp2")


@pytest.fixture
def standing() -> tuple[mujoco.MjModel, mujoco.MjData]:
    model = build_model(WAIST, ModelOptions(collisions="full"))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    return model, data


def test_legs_and_their_motors_are_those_of_bp2() -> None:
    assert WAIST.joint_names == (*BP2.joint_names, "waist") and WAIST.waist == 12 and BP2.waist is None
    rows, own = (read_table(robot_table_path(name))[1] for name in ("bp2", "bp2-waist"))
    changed = {name for name in rows if rows[name] != own[name]}
    assert changed == {"body.total_mass", "trunk.inertia"}
    added = {name.rpartition(".")[0] for name in own if name not in rows}
    assert added == {"trunk", "rear_trunk", "joint.waist", "motor.waist"}


def test_the_straight_halves_weigh_and_balance_as_a_trunk(standing) -> None:
    model, data = standing
    assert model.nu == 13 and model.body_mass.sum() == pytest.approx(WAIST.total_mass)
    front, rear = (model.body(name).id for name in WAIST.trunk_bodies)
    mass, place = model.body_mass[[front, rear]], data.xipos[[front, rear]]
    assert mass.sum() == pytest.approx(BP2.mechanics.trunk.mass + WAIST.total_mass - BP2.total_mass)
    assert abs(mass @ place[:, 0] / mass.sum()) < 1e-3


def test_a_positive_waist_raises_the_rear_and_swings_the_rear_legs_back(standing) -> None:
    model, data = standing
    before = {leg: data.geom(f"{leg}_foot").xpos.copy() for leg in WAIST.leg_names}
    data.joint("waist").qpos[0] = 0.2
    mujoco.mj_kinematics(model, data)
    assert np.array_equal(before["FL"], data.geom("FL_foot").xpos)
    assert data.geom("RL_foot").xpos[0] < before["RL"][0] - 0.05
    assert data.body("RL_thigh").xpos[2] > data.body("FL_thigh").xpos[2] + 0.05


def test_either_half_on_the_ground_is_a_fall() -> None:
    plant = Plant(WAIST, PlantOptions(), TrialSettings())
    floor = plant.model.geom("floor").id
    falls = plant._fall_table[floor, [plant.model.geom(name).id for name in WAIST.trunk_bodies]]
    assert falls.tolist() == [1, 1]
