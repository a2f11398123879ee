"""Every policy that comes with the package carries what the command that trained it would write into it."""

from __future__ import annotations

import json
import re
import shlex
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import msgspec
import pytest

pytest.importorskip("mujoco_warp")


from sprintlab.cli.train import parse_training
from sprintlab.control import load_policy, shipped_policies, shipped_policy
from sprintlab.robots import load_robot
from sprintlab.training.runs.named_settings import plain
from sprintlab.training.runs.options import TrainOptions
from sprintlab.training.scaling import speed_scale
from sprintlab.training.settings import ADDED_REWARDS, PpoSettings, without_removed

ROOT = Path(__file__).parents[2]


def test_every_policy_of_the_package_has_its_recipe() -> None:
    assert set(shipped_policies()) == {"sprint", "go1-sprint", "go2-sprint"}


@pytest.mark.parametrize(("name", "robot", "seed"), [("go1-sprint", "go1", 0), ("go2-sprint", "go2", 1)])
def test_a_smaller_robots_policy_was_trained_by_the_command_that_it_names(
    name: str, robot: str, seed: int
) -> None:
    """The default recipe, scaled: what is typed gives the settings whose hash the contract holds."""
    contract = load_policy(shipped_policy(name)).contract
    words = shlex.split(contract.training.command_line)
    assert words[:2] == ["sprintlab", "train"]
    options = parse_training(words[2:])
    settings = options.full_settings()
    assert (contract.robot_name, contract.training.seed) == (settings.robot, settings.seed) == (robot, seed)
    assert contract.training.config_hash == settings.digest()
    assert contract.training.iterations == options.iterations


def test_sprint_was_trained_by_its_recipe(load_script: Callable[[str], ModuleType]) -> None:
    """The last training of the file began 1300 iterations sooner than the recipe's does."""
    recipe = load_script("recipes/sprint.py")
    contract = load_policy(shipped_policy("sprint")).contract
    settings, record = recipe.fourth_settings(), contract.training
    assert contract.robot_name == settings.robot
    assert (record.iterations, record.seed) == (recipe.ENDS["fourth"] - SOONER, settings.seed)
    trained = recipe.ENDS["fourth"] - recipe.ENDS["second"]
    assert record.environment_steps == trained * 8192 * settings.ppo.steps
    assert "averaged with those of fast" in record.command_line
    assert contract.turning == recipe.TURNING
    calibrated = re.search(r"calibrate .* --top-speed ([\d.]+) --lead ([\d.]+)", recipe.__doc__ or "")
    assert calibrated is not None and contract.calibration is not None and contract.pace is not None
    assert contract.calibration.given[-1] == float(calibrated[1]), "no faster command was measured"
    assert contract.pace.lead == float(calibrated[2])
    assert msgspec.structs.replace(contract.pace, lead=recipe.PACE.lead) == recipe.PACE


SOONER = 1300
"""Iterations by which the recorded third and fourth training begin and end sooner than the recipe's."""


@pytest.mark.parametrize(
    ("name", "training", "looks", "sooner"),
    [
        ("first", "Y1", "fifth", 0),
        ("second", "Y2", "fifth", 0),
        ("third", "F1", "sixth", SOONER),
        ("fourth", "F2", "sixth", SOONER),
    ],
)
def test_the_recipe_has_the_settings_that_were_recorded(
    load_script: Callable[[str], ModuleType], name: str, training: str, looks: str, sooner: int
) -> None:
    settings = getattr(load_script("recipes/sprint.py"), f"{name}_settings")()
    chosen = json.loads(json.dumps(plain(settings)))
    chosen["ppo"]["calm_iterations"] = [each - sooner for each in chosen["ppo"]["calm_iterations"]]
    if sooner:  # the fine-tuning phase began long before: 100 iterations more or less change nothing
        chosen["stages"]["steady_iteration"] += 100
    for part, values in recorded_settings(looks, training).items():
        assert chosen[part] == as_it_would_be_recorded_now(part, values), (name, part)


def recorded_settings(looks: str, training: str) -> dict[str, Any]:
    """Settings of a training that is recorded as another's with changes."""
    found = json.loads((ROOT / f"results/{looks}-looks/trainings.json").read_text(encoding="utf-8"))
    record = found["policies"][training]
    others = json.loads((ROOT / found["settings_of"]).read_text(encoding="utf-8"))["policies"]
    settings = others[record["base"]]["settings"]
    for path, value in record["changes"].items():
        *places, last = path.split(".")
        place = settings
        for each in places:
            place = place.setdefault(each, {"first": 0.0})
        place[last] = value
    return settings


def as_it_would_be_recorded_now(part: str, values: Any) -> Any:
    """Settings without those that did nothing and are gone, and later rewards without weight."""
    if part == "rewards":
        return {name: {"first": 0.0, "second": 0.0} for name in ADDED_REWARDS} | values
    return without_removed(PpoSettings, values) if part == "ppo" else values


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> list[TrainOptions]:
    """What a recipe asks to be trained; nothing is."""
    found: list[TrainOptions] = []

    def train(options: TrainOptions) -> Path:
        found.append(options)
        (options.output / "checkpoint.pt").parent.mkdir(parents=True)
        return options.output / "checkpoint.pt"

    monkeypatch.setattr("sprintlab.training.runs.run.train", train)
    monkeypatch.setattr("sprintlab.training.runs.options.check_checkpoint", lambda path: {"growth": 1})
    monkeypatch.setattr("sprintlab.training.runs.options.read_policy_start", lambda *arguments: None)
    return found


@pytest.fixture
def averaged(monkeypatch: pytest.MonkeyPatch) -> list[tuple[Any, ...]]:
    """Of which checkpoints a recipe asks the mean, with what else it asks of it."""
    found: list[tuple[Any, ...]] = []
    monkeypatch.setattr(
        "sprintlab.training.runs.averaging.average_checkpoints",
        lambda paths, output, *more: found.append((paths, *more)) or SimpleNamespace(path=output),
    )
    return found


def test_the_recipe_trains_four_times_and_averages_twice(
    load_script: Callable[[str], ModuleType],
    asked: list[TrainOptions],
    averaged: list[tuple[Any, ...]],
    tmp_path: Path,
) -> None:
    recipe = load_script("recipes/sprint.py")
    own = tmp_path / "own"
    first, second, third, fourth = (own / name / "checkpoint.pt" for name in recipe.ENDS)
    assert recipe.main(replace(recipe.DEFAULTS, output=own)) == own / "policy.onnx"
    assert [each.full_settings().seed for each in asked] == [12, 12, 31, 31]
    assert [each.iterations for each in asked] == [1750, 3300, 4700, 6100]
    assert [each.start_from for each in asked] == [None, first, own / "begun.onnx", third]
    mean = ((first, second, fourth), recipe.SHARES, recipe.PACE, recipe.TURNING)
    assert averaged == [((first, second),), mean]
    recipe.main(replace(recipe.DEFAULTS, output=tmp_path / "other", seed=7, environments=64, iterations=610))
    assert [each.full_settings().seed for each in asked[4:]] == [7] * 4
    assert [each.full_settings().simulation.environments for each in asked] == [8192] * 4 + [64] * 4
    assert [each.iterations for each in asked[4:]] == [175, 330, 470, 610]


def test_the_recipe_is_scaled_to_another_robot_whole(
    load_script: Callable[[str], ModuleType],
    asked: list[TrainOptions],
    averaged: list[tuple[Any, ...]],
    tmp_path: Path,
) -> None:
    """What the recipe changed is scaled as well as what it left at the defaults."""
    recipe = load_script("recipes/sprint.py")
    recipe.main(replace(recipe.DEFAULTS, output=tmp_path / "own", robot="go1"))
    size = speed_scale(load_robot("go1"))
    settings = [each.full_settings() for each in asked]
    assert {each.robot for each in settings} == {"go1"}
    assert settings[3].rewards.shortest_stride == pytest.approx(0.205 * size)
    assert settings[3].stages.growth_margin == pytest.approx(1.5 * size)
    assert settings[3].rewards.foot_force == recipe.fourth_settings().rewards.foot_force
    pace, turning = averaged[1][2:]
    assert (pace.power, pace.lead) == pytest.approx((30.0 * size, 3.0 * size))
    assert turning.fastest * turning.limit == pytest.approx(recipe.TURNING.fastest * recipe.TURNING.limit)
