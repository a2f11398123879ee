"""Motions without a policy begin and end where they should, without a jump."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sprintlab.deployment.controller.motion import JointMotion, SinkMotion, Waypoint, folded_pose
from sprintlab.robots import load_robot

BP2 = load_robot("bp2")
A, B = BP2.mechanics.thigh_length, BP2.mechanics.shank_length


def feet(pose):
    """Position of each foot from its hip, in the plane of the leg: x forward, z up ``(4, 2)``."""
    _, hip, knee = np.asarray(pose).reshape(4, 3).T
    x = -(A * np.sin(hip) + B * np.sin(hip + knee))
    z = -(A * np.cos(hip) + B * np.cos(hip + knee))
    return np.stack((x, z), axis=1)


def test_the_folded_pose_has_its_feet_below_the_hips_and_room_at_the_stops():
    pose = folded_pose(BP2)
    assert feet(pose)[:, 0] == pytest.approx(np.zeros(4), abs=1e-12)
    assert (feet(pose)[:, 1] > 0.5 * feet(BP2.default_pose)[:, 1]).all()
    lower, upper = BP2.position_limits.T
    assert (pose > lower + BP2.soft_stop.zone).all() and (pose < upper - BP2.soft_stop.zone).all()


def test_a_motion_passes_its_waypoints_without_a_jump():
    start, first, second = np.zeros(12), np.full(12, 0.5), np.full(12, -0.2)
    motion = JointMotion(start, 2.0, Waypoint(first, 1.0), Waypoint(second, 0.5))
    assert motion.end_time == 3.5
    for time, pose in ((0.0, start), (2.0, start), (3.0, first), (3.5, second), (9.0, second)):
        np.testing.assert_allclose(motion.target(time), pose, atol=1e-12)
    path = np.array([motion.target(time) for time in np.arange(2.0, 3.6, 0.001)])
    assert np.abs(np.diff(path, axis=0)).max() < 0.003
    assert np.abs(np.diff(path, n=2, axis=0)).max() < 2e-5


@given(st.lists(st.tuples(st.floats(-0.3, 0.3), st.floats(0.35, 1.0)), min_size=4, max_size=4))
def test_sinking_keeps_every_foot_where_it_stands(angles):
    legs = [(abad, hip, -1.2 - 0.5 * (hip - 0.7)) for abad, hip in angles]
    start = np.array(legs).reshape(-1)
    motion = SinkMotion(BP2, start, 1.0, 1.5)
    np.testing.assert_allclose(motion.target(1.0), start, atol=1e-9)
    for time in np.linspace(1.0, 2.5, 7):
        np.testing.assert_allclose(feet(motion.target(time))[:, 0], feet(start)[:, 0], atol=1e-9)
    end = feet(motion.target(motion.end_time))
    np.testing.assert_allclose(end[:, 1], feet(folded_pose(BP2))[:, 1], atol=1e-9)
