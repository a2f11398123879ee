"""The shipped policy carries the hash of the recipe's settings."""

from __future__ import annotations

import runpy
from dataclasses import replace
from pathlib import Path

import pytest

pytest.importorskip("mujoco_warp")

from sprintlab.control import load_policy, shipped_policy
from sprintlab.training.settings import LATER_FIELDS

RECIPE = Path(__file__).parents[2] / "recipes" / "bp2_sprint.py"


def test_the_shipped_policy_was_trained_by_the_recipe() -> None:
    recipe = runpy.run_path(str(RECIPE))
    settings, record = recipe["shipped_settings"](), load_policy(shipped_policy()).contract.training
    assert record.config_hash == settings.digest()
    assert record.iterations == recipe["ITERATIONS"]
    assert record.seed == settings.seed
    assert record.command_line == f"python recipes/{RECIPE.name} --output runs/bp2-sprint"


def test_a_later_field_counts_as_soon_as_it_changes_something() -> None:
    settings = runpy.run_path(str(RECIPE))["shipped_settings"]()
    assert LATER_FIELDS["heading_hold"] == settings.heading_hold
    assert replace(settings, heading_hold=True).digest() != settings.digest()
    for name, value in (("precision", "bfloat16"), ("quiet_share", 0.1), ("quiet_noise", 0.5)):
        assert replace(settings, ppo=replace(settings.ppo, **{name: value})).digest() != settings.digest()
    braking = replace(settings.schedule, braking_window=2.0)
    assert replace(settings, schedule=braking).digest() != settings.digest()
