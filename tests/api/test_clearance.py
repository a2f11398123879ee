"""Who may drive a robot that is not a simulation on this machine."""

from types import SimpleNamespace

import pytest

from sprintlab.api import clearance
from sprintlab.api.clearance import (
    HARMFUL,
    ClearanceError,
    cleared_speed,
    objections,
    permitted_speed,
    stored_speed,
)
from sprintlab.control import load_policy, shipped_policy
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


def test_a_stored_speed_passes():
    policy = load_policy(shipped_policy("go2-sprint"))
    speed = stored_speed(policy)
    if not speed:
        pytest.skip("none is stored")
    assert not objections(policy, load_robot("go2"), speed, self_paced=True)
