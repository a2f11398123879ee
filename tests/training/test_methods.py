"""The six methods and what sets them apart."""

from __future__ import annotations

import pytest

pytest.importorskip("rsl_rl")

from sprintlab.core.errors import InvalidValueError
from sprintlab.training.methods import METHODS, method_settings
from sprintlab.training.settings import PpoSettings, TrainingSettings

BASE = TrainingSettings(ppo=PpoSettings(steps=7), seed=11)


def changed(name: str, other: str) -> set[str]:
    """Fields of the two methods' settings that differ."""
    first, second = vars(method_settings(name, BASE)), vars(method_settings(other, BASE))
    return {field for field in first if first[field] != second[field]} - {"method"}


def test_there_are_six() -> None:
    assert set(METHODS) == {
        "baseline", "no-envelope", "simplified-dc", "fixed-acceleration", "uniform-commands", "sprint",
    }  # fmt: skip


@pytest.mark.parametrize(
    ("name", "other", "switch"),
    [
        ("no-envelope", "sprint", "actuator_model"),
        ("simplified-dc", "sprint", "actuator_model"),
        ("fixed-acceleration", "sprint", "schedule"),
        ("uniform-commands", "sprint", "schedule"),
        ("baseline", "no-envelope", "schedule"),
        ("baseline", "uniform-commands", "actuator_model"),
    ],
)
def test_neighbours_are_one_switch_apart(name: str, other: str, switch: str) -> None:
    assert changed(name, other) == {switch}


@pytest.mark.parametrize("name", METHODS)
def test_a_method_keeps_the_rest_of_its_base(name: str) -> None:
    settings = method_settings(name, BASE)
    assert settings.method == name
    assert (settings.ppo, settings.seed, settings.rewards) == (BASE.ppo, 11, BASE.rewards)


def test_every_method_has_its_own_digest() -> None:
    assert len({method_settings(name).digest() for name in METHODS}) == 6


def test_an_unknown_method_is_refused_by_name() -> None:
    with pytest.raises(InvalidValueError, match=r"gallop.*sprint"):
        method_settings("gallop")
