"""Who may drive a robot that is not a simulation on this machine."""

from types import SimpleNamespace

import pytest

from sprintlab.api import clearance
from sprintlab.api.clearance import (
    HARMFUL,
    TRIED_SPEEDS,
    ClearanceError,
    cleared_speed,
    objections,
    permitted_speed,
    stored_speed,
)
from sprintlab.control import load_policy, shipped_policy
from sprintlab.control.policy import shipped_policies
from sprintlab.robots import load_robot


def judged(monkeypatch, *, failed=(), fall_time=None):
    """What is said of a policy whose trial ended like that."""
    items = [
        SimpleNamespace(
            name=name, value=9.0, worst=9.0, unit="x", threshold=3.0, bound="at most", detail="", passed=False
        )
        for name in failed
    ]
    trial = SimpleNamespace(
        audit=SimpleNamespace(failed=items), fall_time=fall_time, fall_reason="tilt" if fall_time else ""
    )
    monkeypatch.setattr("sprintlab.evaluation.trial.run_trial", lambda *_: trial)
    asked = {"self_paced": False, "needed": True, "tell": lambda text: None}
    permitted_speed("fast", None, None, 5.0, **asked)


@pytest.mark.parametrize("item", HARMFUL)
def test_what_breaks_a_robot_is_refused_and_says_how_to_insist(monkeypatch, item):
    with pytest.raises(
        ClearanceError, match=f"at up to 5 m/s: in simulation {item} 9.* --despite-audit fast"
    ):
        judged(monkeypatch, failed=[item])


def test_a_fall_is_refused(monkeypatch):
    with pytest.raises(ClearanceError, match=r"it fell after 3\.2 s \(tilt\)"):
        judged(monkeypatch, fall_time=3.2)


def test_the_highest_speed_that_passes_is_found(monkeypatch):
    monkeypatch.setattr(clearance, "objections", lambda p, r, speed, **_: ["falls"] if speed > 4.5 else [])
    assert cleared_speed(None, None, self_paced=True) == 4.0
    monkeypatch.setattr(clearance, "objections", lambda *_, **__: ["falls"])
    assert cleared_speed(None, None, self_paced=True) == 0.0


@pytest.mark.parametrize("name", shipped_policies())
def test_a_stored_speed_is_one_that_was_tried(name):
    """A policy that changed has none: ``python tools/cleared_speeds.py`` stores it."""
    assert stored_speed(load_policy(shipped_policy(name))) in (None, 0.0, *TRIED_SPEEDS)


def test_a_stored_speed_passes():
    policy = load_policy(shipped_policy("go2-sprint"))
    speed = stored_speed(policy)
    if not speed:
        pytest.skip("none is stored")
    assert not objections(policy, load_robot("go2"), speed, self_paced=True)


def test_a_real_trial_is_judged():
    """The Go1's policy hits the ground too hard, even at 2 m/s."""
    policy = load_policy(shipped_policy("go1-sprint"))
    (objection,) = objections(policy, load_robot("go1"), 2.0, self_paced=False)
    assert objection.startswith("foot force 4")
