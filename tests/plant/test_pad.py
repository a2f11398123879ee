"""The feet's pads against the exact solution of a mass on a pad, and under a robot that stands."""

import numpy as np
import pytest
from benchmarks.foot_drop import FRICTION, drop_course, drop_test, exact_drop

from sprintlab.plant import Ground, Plant, PlantOptions, TrialSettings
from sprintlab.robots import FootContact, load_robot

MASS = 1.6  # of BP2's leg [kg]
STEP = PlantOptions().timestep
PHASES = (0.1, 0.35, 0.6, 0.85)


@pytest.mark.parametrize("along", [0.0, 1.0, 3.0, 8.0])
@pytest.mark.parametrize("speed", [1.0, 2.0, 4.0, 8.0])
def test_force_and_rebound_are_exact_whether_the_foot_slides_or_not(speed: float, along: float) -> None:
    foot = FootContact()
    exact = exact_drop(foot, MASS, speed)
    for phase in PHASES:
        shown = drop_test(foot, MASS, (speed, along), STEP, phase)
        assert shown.peak_force == pytest.approx(exact.peak_force, rel=0.03)
        assert shown.restitution == pytest.approx(exact.restitution, rel=0.03)


@pytest.mark.parametrize("speed", [1.0, 3.0, 6.0])
def test_a_sliding_foot_is_slowed_by_friction_times_the_normal_impulse(speed: float) -> None:
    exact = exact_drop(FootContact(), MASS, speed)
    shown = drop_test(FootContact(), MASS, (speed, 8.0), STEP)
    assert exact.slowed < 8.0
    assert shown.slowed == pytest.approx(exact.slowed, rel=0.01)


def test_the_way_slid_is_that_of_the_foot_without_the_stretch_of_the_pad() -> None:
    deflection, along, *_, slid = drop_course(FootContact(), MASS, (3.0, 8.0), STEP).T
    way = STEP * along[deflection > 0.0].sum()
    assert 0.9 * way < slid[-1] <= way


@pytest.mark.parametrize("along", [0.5, 2.0, 8.0])
def test_a_pad_never_pulls_and_friction_stays_inside_of_its_cone(along: float) -> None:
    *_, tangential, normal, _ = drop_course(FootContact(), MASS, (3.0, along), STEP).T
    assert normal.max() > 0.0
    assert (normal >= 0.0).all()
    assert (np.abs(tangential) <= FRICTION * normal * (1.0 + 1e-9)).all()


@pytest.mark.parametrize("along", [0.0, 3.0])
@pytest.mark.parametrize("speed", [2.0, 4.0])
@pytest.mark.parametrize("stiffness", [40e3, 80e3, 160e3])
@pytest.mark.parametrize("restitution", [0.2, 0.4, 0.6])
def test_the_whole_band_shows_its_numbers(
    restitution: float, stiffness: float, speed: float, along: float
) -> None:
    foot = FootContact(stiffness=stiffness, restitution=restitution)
    exact = exact_drop(foot, MASS, speed)
    shown = drop_test(foot, MASS, (speed, along), STEP)
    assert shown.restitution == pytest.approx(restitution, rel=0.1)
    assert shown.deflection == pytest.approx(exact.deflection, rel=0.1)


def test_the_closed_form_solves_the_equation_of_motion() -> None:
    """Fine explicit integration of m a = -(k x + b v) until the force ends."""
    foot, step = FootContact(), 1e-6
    x, v, deepest, hardest = 0.0, 2.0, 0.0, 0.0
    while (force := foot.stiffness * x + foot.damping(MASS) * v) > 0.0:
        v -= step * force / MASS
        x += step * v
        deepest, hardest = max(deepest, x), max(hardest, force)
    exact = exact_drop(foot, MASS, 2.0)
    assert -v / 2.0 == pytest.approx(exact.restitution, rel=1e-3) == pytest.approx(0.4, rel=1e-3)
    assert deepest == pytest.approx(exact.deflection, rel=1e-3)
    assert hardest == pytest.approx(exact.peak_force, rel=1e-3)


def test_a_robot_stands_on_a_slope_without_sliding() -> None:
    robot = load_robot("bp2")
    plant = Plant(robot, PlantOptions(ground=Ground(slope=0.05)), TrialSettings())
    assert plant.advance(robot.default_pose, 1000)
    normal, deflection = np.array(plant.pads.normal_force), np.array(plant.pads.deflection)
    assert normal.sum() == pytest.approx(robot.total_mass * 9.81 / np.hypot(1.0, 0.05), rel=0.03)
    np.testing.assert_allclose(normal, 80e3 * deflection, rtol=0.01)
    assert max(plant.pads.slid) == 0.0
    assert np.linalg.norm(plant.data.qvel[:3]) < 0.1


def test_a_robot_put_on_its_feet_again_stands_as_it_did_at_first() -> None:
    robot = load_robot("bp2")
    plant = Plant(robot, PlantOptions(), TrialSettings())
    ends = []
    for _ in range(2):
        plant._place(TrialSettings())
        plant.advance(robot.default_pose, 100)
        ends.append(plant.data.qpos.copy())
    np.testing.assert_array_equal(*ends)
