"""Every policy of the package carries what the recipe that trained it would write into it."""

from __future__ import annotations

from collections.abc import Callable
from types import ModuleType

import pytest

pytest.importorskip("mujoco_warp")

from sprintlab.control import load_policy, shipped_policy
from sprintlab.control.policy import SHIPPED_POLICIES

RECIPES = {
    "sprint": ("bp2_sprint", "shipped_settings"),
    "sprint-fast": ("bp2_fast_sprint", "shipped_settings"),
    "go1-sprint": ("go1_sprint", "go1_settings"),
}
"""Script of a policy, and the function that tells its settings."""


def test_every_policy_of_the_package_has_a_recipe() -> None:
    assert {path.stem for path in SHIPPED_POLICIES.glob("*.onnx")} == set(RECIPES)


@pytest.mark.parametrize("policy", RECIPES)
def test_the_shipped_policy_was_trained_by_its_recipe(
    policy: str, load_script: Callable[[str], ModuleType]
) -> None:
    script, function = RECIPES[policy]
    recipe, contract = load_script(f"recipes/{script}.py"), load_policy(shipped_policy(policy)).contract
    settings, record = getattr(recipe, function)(), contract.training
    assert contract.robot_name == settings.robot
    assert record.config_hash == settings.digest()
    assert record.iterations == recipe.ITERATIONS
    assert record.seed == settings.seed
    assert record.command_line == f"python recipes/{script}.py --output runs/{script.replace('_', '-')}"
