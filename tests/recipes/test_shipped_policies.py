"""Every policy that comes with the package carries what the command that trained it would write into it."""

from __future__ import annotations

import shlex
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import pytest

pytest.importorskip("mujoco_warp")


from sprintlab.cli.train import parse_training
from sprintlab.control import load_policy, shipped_policy
from sprintlab.control.policy import SHIPPED_POLICIES
from sprintlab.training.runs.options import TrainOptions

COMMANDS = ("sprint", "sprint-fast")
"""Policies of ``sprintlab train``; the others have a script."""


def test_every_policy_of_the_package_has_its_command_or_recipe() -> None:
    assert {path.stem for path in SHIPPED_POLICIES.glob("*.onnx")} == {*COMMANDS, "go1-sprint", "runner"}


@pytest.mark.parametrize("policy", COMMANDS)
def test_the_shipped_policy_was_trained_by_its_command(policy: str) -> None:
    contract = load_policy(shipped_policy(policy)).contract
    record, (_, train, *words) = contract.training, shlex.split(contract.training.command_line)
    options = parse_training(words)
    settings = options.full_settings()
    assert train == "train" and contract.robot_name == f"{settings.robot}-first"  # the edition of that time
    assert (record.iterations, record.seed) == (options.iterations, options.seed)


@pytest.mark.parametrize("policy", COMMANDS)
def test_but_for_the_precision_it_was_trained_with_the_defaults(policy: str) -> None:
    words = shlex.split(load_policy(shipped_policy(policy)).contract.training.command_line)
    trained = parse_training(words[2:])
    short = ["--seed", str(trained.seed), "--ppo.precision", "bfloat16"]
    again = parse_training([trained.method, *short])
    assert again.full_settings() == trained.full_settings() and again.iterations == trained.iterations


def test_the_go1_policy_was_trained_by_its_recipe(load_script: Callable[[str], ModuleType]) -> None:
    recipe = load_script("recipes/go1_sprint.py")
    contract = load_policy(shipped_policy("go1-sprint")).contract
    settings, record = recipe.go1_settings(), contract.training
    assert contract.robot_name == settings.robot
    assert (record.iterations, record.seed) == (recipe.DEFAULTS.iterations, settings.seed)
    assert record.command_line == "python recipes/go1_sprint.py --output runs/go1-sprint"


def test_the_runner_was_trained_by_its_recipe(load_script: Callable[[str], ModuleType]) -> None:
    recipe = load_script("recipes/runner.py")
    contract = load_policy(shipped_policy("runner")).contract
    settings, record = recipe.runner_settings(), contract.training
    assert contract.robot_name == settings.robot and record.seed == settings.seed
    assert (
        0.99 * recipe.DEFAULTS.iterations < record.iterations <= recipe.DEFAULTS.iterations
    )  # it ended when its time was up
    assert record.environment_steps == record.iterations * 8192 * settings.ppo.steps
    assert record.command_line == "python recipes/runner.py --output runs/runner"


def test_a_recipe_trains_the_seed_of_its_settings(
    load_script: Callable[[str], ModuleType], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    asked: list[TrainOptions] = []
    monkeypatch.setattr("sprintlab.training.runs.run.train", asked.append)
    recipe = load_script("recipes/runner.py")
    recipe.main(replace(recipe.DEFAULTS, output=tmp_path / "own"))
    recipe.main(replace(recipe.DEFAULTS, output=tmp_path / "other", seed=7, environments=64))
    assert [options.full_settings().seed for options in asked] == [recipe.runner_settings().seed, 7] == [1, 7]
    assert [options.full_settings().simulation.environments for options in asked] == [8192, 64]
