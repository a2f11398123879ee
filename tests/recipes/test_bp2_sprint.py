"""A field newer than ``sprint`` counts in the hash as soon as it changes something."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from types import ModuleType

import pytest

pytest.importorskip("mujoco_warp")

from sprintlab.training.settings import LATER_FIELDS


def test_a_later_field_counts_as_soon_as_it_changes_something(
    load_script: Callable[[str], ModuleType],
) -> None:
    settings = load_script("recipes/bp2_sprint.py").shipped_settings()
    assert LATER_FIELDS["heading_hold"] == settings.heading_hold
    assert replace(settings, heading_hold=True).digest() != settings.digest()
    for name, value in (("precision", "bfloat16"), ("quiet_share", 0.1), ("quiet_noise", 0.5)):
        assert replace(settings, ppo=replace(settings.ppo, **{name: value})).digest() != settings.digest()
    braking = replace(settings.schedule, braking_window=2.0)
    assert replace(settings, schedule=braking).digest() != settings.digest()
