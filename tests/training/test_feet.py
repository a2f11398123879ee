"""The training world's feet and air: the same numbers as the plant's."""

import mujoco_warp
import numpy as np
import pytest
import warp as wp
from benchmarks.foot_drop import drop_model, expected_drop

from sprintlab.robots import (
    FootContact,
    air_drag,
    contact_law,
    drop_outcome,
    load_robot,
)
from sprintlab.training.environment.feet import contact_laws
from sprintlab.training.environment.simulation import BatchSimulation
from sprintlab.training.settings import SimulationSettings

MASS, STEP = 1.2, SimulationSettings().timestep
PHASES = 16


@pytest.mark.parametrize("speed", [2.0, 4.0])
def test_a_drop_in_mujoco_warp_shows_the_pad(speed: float) -> None:
    """One drop a world, each with another phase between two steps."""
    import mujoco

    foot = FootContact()
    model = drop_model(foot, MASS, STEP)
    model.opt.iterations, model.opt.ls_iterations = 3, 12
    data = mujoco.MjData(model)
    data.qvel[2] = -speed
    courses = []
    with wp.ScopedDevice("cpu"):
        warp_model = mujoco_warp.put_model(model)
        world = mujoco_warp.put_data(model, data, nworld=PHASES)
        qpos, qvel = world.qpos.numpy(), world.qvel.numpy()
        qpos[:, 2] += (np.arange(PHASES) + 0.5) / PHASES * STEP * speed
        for _ in range(20):
            before = qpos.copy(), qvel.copy()
            world.qpos.assign(qpos)
            mujoco_warp.step(warp_model, world)
            qpos, qvel = world.qpos.numpy(), world.qvel.numpy()
            courses.append((0.03 - before[0][:, 2], before[1][:, 2], MASS * (qvel - before[1])[:, 2] / STEP))
    columns = np.array(courses)
    drops = [drop_outcome(STEP, *columns[:, :, world].T) for world in range(PHASES)]
    expected = expected_drop(foot, MASS, speed)
    for name in ("stiffness", "restitution", "deflection", "contact_time"):
        shown = np.mean([getattr(drop, name) for drop in drops])
        assert shown == pytest.approx(getattr(expected, name), rel=0.2), name


def test_the_table_of_laws_meets_the_law_itself() -> None:
    random = np.random.default_rng(0)
    stiffness, restitution = random.uniform(40e3, 100e3, 40), random.uniform(0.3, 0.6, 40)
    laws = contact_laws(stiffness, restitution, MASS, STEP)
    for index in range(0, 40, 8):
        law = contact_law(FootContact(stiffness=stiffness[index], restitution=restitution[index]), MASS, STEP)
        assert laws.stiffness[index] == pytest.approx(law.stiffness, rel=0.1)
        assert laws.damping[index] == pytest.approx(law.damping, rel=0.1)


def test_equal_feet_need_no_table() -> None:
    laws = contact_laws(np.full(3, 80e3), np.full(3, 0.4), MASS, STEP)
    law = contact_law(FootContact(), MASS, STEP)
    np.testing.assert_allclose(laws.stiffness, law.stiffness)
    np.testing.assert_allclose(laws.added_mass, law.added_mass)


def test_the_air_acts_on_the_trunk() -> None:
    simulation = BatchSimulation(load_robot("bp2"), SimulationSettings(environments=2), "refined", "cpu")
    simulation.qvel[0, :3] = simulation.qvel.new_tensor((8.0, 1.0, -0.5))
    simulation.drag_area[:] = simulation.drag_area.new_tensor((0.12, 0.2))
    simulation.actuate(0)
    force = simulation.data.xfrc_applied.numpy()
    trunk = simulation.mj_model.body("trunk").id
    np.testing.assert_allclose(force[0, trunk, :3], air_drag(np.array((8.0, 1.0, -0.5)), 0.12), rtol=1e-5)
    assert not force[1].any()
