"""Every policy that comes with the package carries what the command that trained it would write into it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import pytest

pytest.importorskip("mujoco_warp")


from sprintlab.control import load_policy, shipped_policies, shipped_policy
from sprintlab.training.runs.options import TrainOptions


def test_every_policy_of_the_package_has_its_recipe() -> None:
    assert set(shipped_policies()) == {"sprint", "go1-sprint"}


def test_the_go1_policy_was_trained_by_its_recipe(load_script: Callable[[str], ModuleType]) -> None:
    recipe = load_script("recipes/go1_sprint.py")
    contract = load_policy(shipped_policy("go1-sprint")).contract
    settings, record = recipe.go1_settings(), contract.training
    assert contract.robot_name == settings.robot
    assert (record.iterations, record.seed) == (recipe.DEFAULTS.iterations, settings.seed)
    assert record.command_line == "python recipes/go1_sprint.py --output runs/go1-sprint"


def test_sprint_was_trained_by_its_recipe(load_script: Callable[[str], ModuleType]) -> None:
    recipe = load_script("recipes/sprint.py")
    contract = load_policy(shipped_policy("sprint")).contract
    settings, record = recipe.sprint_settings(), contract.training
    assert contract.robot_name == settings.robot and record.seed == settings.seed
    assert (
        0.99 * recipe.DEFAULTS.iterations < record.iterations <= recipe.DEFAULTS.iterations
    )  # it ended when its time was up
    assert record.environment_steps == record.iterations * 8192 * settings.ppo.steps
    assert record.command_line == "python recipes/runner.py --output runs/runner"  # as it was called then


def test_a_recipe_trains_the_seed_of_its_settings(
    load_script: Callable[[str], ModuleType], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    asked: list[TrainOptions] = []
    monkeypatch.setattr("sprintlab.training.runs.run.train", asked.append)
    recipe = load_script("recipes/sprint.py")
    recipe.main(replace(recipe.DEFAULTS, output=tmp_path / "own"))
    recipe.main(replace(recipe.DEFAULTS, output=tmp_path / "other", seed=7, environments=64))
    assert [options.full_settings().seed for options in asked] == [recipe.sprint_settings().seed, 7] == [1, 7]
    assert [options.full_settings().simulation.environments for options in asked] == [8192, 64]
