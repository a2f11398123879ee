"""Constraints that end a share of the future, and the chances that follow how often they are broken."""

from __future__ import annotations

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from sprintlab.core.errors import InvalidValueError
from sprintlab.training.environment.constraints import (
    INITIAL_CHANCE,
    WATCHED,
    Chances,
    Monitors,
    broken_parts,
    by_phase,
    command_phases,
    ended_share,
    nominal_deflection,
)
from sprintlab.training.learner.losses import generalized_advantages
from sprintlab.training.settings import CONSTRAINTS, PHASES, Constraint, ConstraintSettings, PpoSettings

SETTINGS = ConstraintSettings()


def monitors(**changed: float) -> Monitors:
    """One robot within all limits but those that are changed, each at one foot, joint or pair of legs."""
    columns = {"foot_force": 4, "pad_deflection": 4, "leg_distance": 6}
    harmless = {"leg_distance": 1.0}
    values = {
        name: torch.full((1, columns.get(name, 12)), harmless.get(name, 0.0)) for name in Monitors._fields
    }
    for name, value in changed.items():
        values[name][0, 1] = value
    return Monitors(**values)


MONITOR = {
    "foot": "foot_force",
    "gear": "gear_torque",
    "legs": "leg_distance",
    "joint_speed": "joint_speed",
    "end_stop": "stop_depth",
}


def broken(name: str, value: float, monitor: str | None = None) -> float:
    """The part by which one constraint is broken at a monitor's value; no other is."""
    parts = broken_parts(monitors(**{monitor or MONITOR[name]: value}), SETTINGS)[0].tolist()
    own = parts.pop(CONSTRAINTS.index(name))
    assert not any(parts)
    return own


@given(st.sampled_from(CONSTRAINTS), st.floats(-0.5, 2.0))
def test_the_worst_foot_joint_or_pair_decides(name: str, part: float) -> None:
    chosen = getattr(SETTINGS, name)
    found = broken(name, chosen.limit + part * (chosen.full - chosen.limit))
    assert found == pytest.approx(min(max(part, 0.0), 1.0), abs=1e-4)


def test_a_pad_counts_as_a_force_and_nan_as_broken_in_full() -> None:
    foot = SETTINGS.foot
    part = (3.8 - foot.limit) / (foot.full - foot.limit)
    assert broken("foot", 0.015 * 3.8 / 4.0, "pad_deflection") == pytest.approx(part, abs=1e-5)
    assert broken("gear", float("nan")) == 1.0


@pytest.mark.parametrize(
    ("command", "target", "running", "phase"),
    [
        (10.0, 10.0, 9.5, "hold"),
        (10.0, 12.0, 10.0, "push"),
        (10.0, 10.0, 8.0, "push"),
        (10.0, 0.0, 10.0, "brake"),
        (10.0, 0.0, 2.0, "brake"),
    ],
)
def test_what_a_command_asks_for(command: float, target: float, running: float, phase: str) -> None:
    values = (torch.tensor([value]) for value in (command, target, running))
    assert command_phases(*values)[0].tolist() == [float(phase == name) for name in PHASES]


def test_only_the_chances_of_the_own_phase_count_and_constraints_multiply() -> None:
    chances = torch.rand(len(WATCHED))
    parts = torch.tensor([[0.5, 0.0, 1.0, 0.0, 0.2]])
    brake = torch.tensor([[0.0, 0.0, 1.0]])
    own = chances[2 * len(CONSTRAINTS) :]
    expected = 1.0 - (1 - 0.5 * own[0]) * (1 - own[2]) * (1 - 0.2 * own[4])
    torch.testing.assert_close(ended_share(by_phase(brake, parts), chances), expected[None])


def test_a_soft_end_discounts_the_future_by_hand() -> None:
    """Two steps; a quarter of the future ends with the first: worked out on paper."""
    settings = PpoSettings(discount=0.9)
    rewards, values = torch.tensor([[1.0, 2.0]]), torch.tensor([[3.0, 4.0]])
    found = generalized_advantages(
        rewards, values, torch.tensor([[0.25, 0.0]]), torch.zeros(1, 2), torch.tensor([5.0]), settings
    )
    second = 2.0 + 0.9 * 5.0 - 4.0
    first = 1.0 + 0.75 * 0.9 * 4.0 - 3.0 + 0.75 * 0.9 * 0.95 * second
    torch.testing.assert_close(found, torch.tensor([[first, second]]))


def row(share: float, name: str = "hold/foot", fast: float = 0.2) -> dict[str, float]:
    """What an iteration logs, where fast robots break one constraint by this part in the mean."""
    nothing = {f"broken/{each}": 0.0 for each in WATCHED} | {f"fast/{phase}": fast for phase in PHASES}
    return nothing | {f"broken/{name}": share * fast}


def chance(chances: Chances, name: str) -> float:
    return chances.values[WATCHED.index(name)]


def test_a_chance_rises_while_its_constraint_is_broken_too_often_up_to_its_cap() -> None:
    chances = Chances(SETTINGS)
    chances.update(row(0.2), moving=True)
    assert chance(chances, "hold/foot") == pytest.approx(0.003 * 1.01, rel=1e-3)
    assert chance(chances, "brake/foot") < 0.003
    for _ in range(1000):
        chances.update(row(0.2), moving=True)
    assert chance(chances, "hold/foot") == pytest.approx(0.1)
    assert chance(chances, "brake/foot") == pytest.approx(0.001)
    for _ in range(1000):
        chances.update(row(0.2, "brake/gear"), moving=True)
    assert chance(chances, "brake/gear") == pytest.approx(0.6), "caps differ"


def test_a_chance_rests_where_it_is_aimed_at_and_before_it_may_move() -> None:
    chances = Chances(SETTINGS)
    chances.update(row(0.2), moving=False)
    assert chances.values == [INITIAL_CHANCE] * len(WATCHED)
    aimed = Chances(ConstraintSettings(foot=Constraint(limit=3.3, full=4.2, aim=0.02)))
    aimed.update(row(0.02), moving=True)
    assert chance(aimed, "hold/foot") == pytest.approx(0.003, rel=1e-4)


def test_the_range_waits_for_feet_and_gears_that_hold() -> None:
    chances = Chances(SETTINGS)
    assert chances.held
    for share, name, held in (
        (0.2, "hold/foot", False),
        (0.001, "hold/foot", True),
        (0.2, "push/foot", True),
    ):
        for _ in range(200):
            chances.update(row(share, name), moving=False)
        assert chances.held is held


def test_phases_that_no_fast_robot_is_in_say_nothing() -> None:
    chances = Chances(SETTINGS)
    chances.update(row(0.2, fast=0.0), moving=True)
    assert chances.shares == [None] * len(WATCHED)


def test_a_checkpoint_keeps_the_chances_and_refuses_others() -> None:
    chances, other = Chances(SETTINGS), Chances(SETTINGS)
    chances.update(row(0.2), moving=True)
    other.load_state_dict(chances.state_dict())
    assert (other.values, other.shares) == (chances.values, chances.shares)
    with pytest.raises(InvalidValueError, match=r"chances\.values"):
        other.load_state_dict({"values": [0.1], "shares": [0.1]})


def test_a_soft_pad_counts_by_the_force_that_it_carries() -> None:
    """The audit's 15 mm are those of a nominal pad; half as stiff, the same force deflects twice as far."""
    measured = nominal_deflection(torch.tensor([[0.024], [0.012]]), torch.tensor([[40e3], [80e3]]))
    torch.testing.assert_close(measured, torch.full((2, 1), 0.012))
