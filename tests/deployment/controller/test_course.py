"""Position fixes: which are kept, for how long they are used, and where they say that the robot is."""

import numpy as np
import pytest
from tests.deployment.messages import make_fix, make_state

from sprintlab.deployment.controller.course import Course


def test_a_fix_that_is_old_comes_twice_or_is_absurd_is_not_taken():
    course = Course()
    assert course.take(make_fix(5), 1.0)
    assert not course.take(make_fix(5), 1.1) and not course.take(make_fix(4), 1.1)
    for wrong in ({"position": np.array([0.0, 1.1e8, 0.0])}, {"velocity": np.array([0.0, np.nan, 0.0])}):
        assert not course.take(make_fix(6, **wrong), 1.1)
    course.forget_fix()
    assert course.take(make_fix(1), 1.2)  # of a robot that was restarted


def test_a_fix_is_carried_on_for_half_a_second():
    course = Course()
    course.start(make_state(quaternion=np.array([np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)])))  # facing y
    assert course.point(0.0) is None
    place = np.array([7.0, 7.0, 0.5])
    course.take(make_fix(1, position=place), 1.0)
    assert course.point(1.0) == pytest.approx((0.0, 0.0, 1.0))  # the run's first place
    course.take(make_fix(2, position=np.array([6.5, 10.0, 0.5]), velocity=np.array([0.0, 4.0, 0.0])), 2.0)
    assert course.point(2.25) == pytest.approx((4.0, 0.5, 4.0))
    assert course.point(2.51) is None
