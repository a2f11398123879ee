"""Position fixes: which are kept, and for how long they are used."""

import numpy as np
from tests.deployment.messages import make_fix

from sprintlab.deployment.controller.course import LastFix


def test_a_fix_that_is_old_or_comes_twice_is_not_taken():
    last = LastFix(0.5)
    assert last.take(make_fix(5), 1.0)
    assert not last.take(make_fix(5), 1.1) and not last.take(make_fix(4), 1.1)
    assert last.fresh(1.1).sequence == 5
    last.forget()
    assert last.take(make_fix(1), 1.2)  # of a robot that was restarted


def test_a_fix_is_used_for_half_a_second_and_an_absurd_one_never():
    last = LastFix(0.5)
    for wrong in ({"position": np.array([0.0, 1.1e8, 0.0])}, {"velocity": np.array([0.0, 0.0, -101.0])}):
        assert not last.take(make_fix(1, **wrong), 1.0)
    last.take(make_fix(1), 1.0)
    assert last.fresh(1.5) is not None and last.fresh(1.501) is None
