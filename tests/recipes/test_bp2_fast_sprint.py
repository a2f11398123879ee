"""The recipe of ``sprint-fast`` trains its two parts in order."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

pytest.importorskip("mujoco_warp")

from sprintlab.training.settings import TrainingSettings


@pytest.fixture
def recipe(load_script: Callable[[str], ModuleType]) -> ModuleType:
    return load_script("recipes/bp2_fast_sprint.py")


@pytest.fixture
def trainings(recipe: ModuleType, monkeypatch: pytest.MonkeyPatch) -> list[dict[str, Any]]:
    """What the recipe asks to be trained; a checkpoint appears where it would."""
    asked: list[dict[str, Any]] = []

    def train(settings: TrainingSettings, **options: Any) -> Path:
        asked.append({"settings": settings, **options})
        options["output"].mkdir(parents=True, exist_ok=True)
        (options["output"] / "checkpoint.pt").touch()
        return options["output"] / "checkpoint.pt"

    monkeypatch.setattr(recipe, "train_settings", train)
    return asked


def test_the_second_part_begins_where_the_first_ends(
    recipe: ModuleType, trainings: list[dict[str, Any]], tmp_path: Path
) -> None:
    recipe.main(recipe.Options(output=tmp_path))
    first, second = trainings
    assert first["settings"] == recipe.fast_settings()
    assert first["iterations"] == recipe.FAST_ITERATIONS < second["iterations"] == recipe.ITERATIONS
    assert second["start_from"] == first["output"] / "checkpoint.pt" != second["output"] / "checkpoint.pt"
    assert (second["settings"], second["environments"]) == (recipe.shipped_settings(), recipe.ROBOTS)


def test_a_stopped_recipe_goes_on_with_the_part_it_was_in(
    recipe: ModuleType, trainings: list[dict[str, Any]], tmp_path: Path
) -> None:
    (tmp_path / "fast").mkdir()
    (tmp_path / "fast" / "checkpoint.pt").touch()
    recipe.main(recipe.Options(output=tmp_path, resume=True))
    assert [training["resume"] for training in trainings] == [True, False]
    recipe.main(recipe.Options(output=tmp_path, resume=True))
    assert trainings[2]["resume"] and trainings[2]["start_from"] is None
    assert len(trainings) == 3
