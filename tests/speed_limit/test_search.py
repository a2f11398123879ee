from dataclasses import replace

import numpy as np
import pytest

from sprintlab.core.errors import SimulationError
from sprintlab.core.theme import png_bytes
from sprintlab.robots import load_robot
from sprintlab.speed_limit import (
    SearchSettings,
    evaluate,
    fastest_stride,
    scalings,
    speed_limit,
    violations,
)
from sprintlab.speed_limit.figure import limit_figure
from sprintlab.speed_limit.stride import GROUPS

ONE_START = SearchSettings(starts=1)


def test_the_stride_found_keeps_every_limit(bp2, fastest):
    broken = violations(bp2, evaluate(bp2, fastest.parameters[None], fastest.speed))
    for name in GROUPS:
        assert np.abs(broken[name]).max() < 3e-3, name


def test_bp2_can_run_faster_than_its_policy_and_slower_than_its_joints(bp2, fastest):
    """A search of trajectories in the plane found 12.6 m/s; at no-load speed a foot reaches 25 m/s."""
    assert 12.0 < fastest.speed < 15.0
    no_load = 39.0 * (bp2.leg.reach + bp2.leg.foot_radius)
    assert fastest.speed < no_load


@pytest.mark.parametrize(("quantity", "factor"), [("mass", 1.6), ("bus voltage", 0.8)])
def test_a_heavier_or_weaker_robot_is_slower(bp2, fastest, monkeypatch, quantity, factor):
    # Enough to come near the fastest; a robot that was as able as before would keep its known stride.
    monkeypatch.setattr("sprintlab.speed_limit.search._EVALUATIONS", 20)
    slower = fastest_stride(scalings(bp2)[quantity](factor), ONE_START, near=(fastest,))
    assert 0.7 * fastest.speed < slower.speed < 0.97 * fastest.speed


def test_without_any_torque_limit_the_search_ends_at_its_ceiling(bp2, fastest):
    kept = [name for name in GROUPS if "hip" not in name and "knee" not in name]
    free = fastest_stride(bp2, ONE_START, groups=kept, near=(fastest,), ceiling=1.05 * fastest.speed)
    assert not free.bounded
    assert free.speed == pytest.approx(1.05 * fastest.speed)


def test_lifting_a_limit_never_makes_slower(bp2, fastest, monkeypatch):
    """Where climbs end depends on the processor's arithmetic; a known stride that keeps the rest counts."""
    monkeypatch.setattr("sprintlab.speed_limit.search._Search.climb", lambda self, start, speed: (0.0, start))
    kept = [name for name in GROUPS if "hip" not in name]
    assert fastest_stride(bp2, ONE_START, groups=kept, near=(fastest,)).speed == fastest.speed
    with pytest.raises(SimulationError, match="no stride is possible"):
        fastest_stride(replace(bp2, mass=2.0 * bp2.mass), ONE_START, near=(fastest,))


def test_scaling_a_gear_takes_the_rotor_along(bp2):
    geared = scalings(bp2)["gear ratio"](2.0)
    np.testing.assert_allclose(geared.leg.armature, 4.0 * bp2.leg.armature)
    assert scalings(bp2)["leg length"](1.5).leg.reach == pytest.approx(1.5 * bp2.leg.reach)


def test_the_whole_answer_and_its_picture(bp2, fastest, monkeypatch):
    def known_or_searched(runner, settings, *, near=(), **options):
        # the first search is that of the fixture
        return fastest if near == () else fastest_stride(runner, settings, near=near, **options)

    monkeypatch.setattr("sprintlab.speed_limit.analysis.fastest_stride", known_or_searched)
    monkeypatch.setattr("sprintlab.speed_limit.search._EVALUATIONS", 20)  # enough to be faster, not fastest
    lifted = {"hip torque": ("hip in stance", "hip in swing")}
    monkeypatch.setattr("sprintlab.speed_limit.analysis.FACTORS", ())
    monkeypatch.setattr("sprintlab.speed_limit.analysis.LIMITS_TO_LIFT", lifted)
    seen = []
    limit = speed_limit(load_robot("bp2"), settings=ONE_START, progress=lambda *told: seen.append(told))
    assert limit.cause == "hip torque"
    assert limit.speed == fastest.speed
    assert limit.lifted[0].speed > 1.05 * limit.speed
    assert limit.sensitivities == ()
    assert seen == [("speed limit", None), ("without hip torque", 0.0)]
    assert png_bytes(limit_figure(limit, bp2)).startswith(b"\x89PNG")
    above = ["The fastest stride", "Hip over its envelope", "Knee over its envelope"]
    assert panels(limit, bp2) == [*above, "Limit if this were no limit"]
    assert panels(replace(limit, lifted=()), bp2) == above


def panels(limit, runner):
    """Titles of a picture's panels: only what was asked for has one."""
    return [axes.get_title(loc="left") for axes in limit_figure(limit, runner).axes]
