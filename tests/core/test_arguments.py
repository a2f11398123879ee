"""Arguments are held against a function's type hints before it begins."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest

from sprintlab.core.arguments import check_fields, checked
from sprintlab.core.errors import InvalidValueError


@dataclass(frozen=True)
class Options:
    count: int = 1
    place: Path | None = None


@checked
def work(
    name: str | Path = "sprint",
    *,
    count: int = 1,
    speed: float | None = None,
    video: bool = False,
    speeds: Sequence[float] = (1.0,),
    changes: Mapping[str, Any] | None = None,
    engine: Literal["mujoco", "drake"] = "mujoco",
    options: Options | None = None,
    progress: Callable[[str], None] = lambda _: None,
) -> str:
    return "worked"


def test_what_fits_goes_through():
    numbers = {"count": 2, "speed": np.float32(2.0), "speeds": np.linspace(1.0, 2.0, 3)}
    assert work(name=Path("a"), video=np.bool_(True), options=Options(), **numbers) == "worked"
    check_fields(Options(count=2, place=Path("a")))


@pytest.mark.parametrize(
    ("given", "allowed"),
    [
        ({"name": 0}, "text or a path"),
        ({"count": 1.5}, "a whole number"),
        ({"speed": math.nan}, "a finite number or None"),
        ({"video": "no"}, "True or False"),
        ({"speeds": 1.0}, "a list, each a finite number"),
        ({"speeds": [1.0, "2"]}, "a list"),
        ({"changes": []}, "a table or None"),
        ({"engine": 3}, "one of mujoco, drake"),
        ({"options": {}}, "Options or None"),
        ({"progress": 1}, "a function"),
    ],
    ids=lambda each: str(each)[:30],
)
def test_what_does_not_fit_is_refused_by_name(given, allowed):
    (name,) = given
    with pytest.raises(InvalidValueError, match=allowed) as refused:
        work(**given)
    assert refused.value.field == name


def test_fields_of_settings_are_held_against_their_hints():
    with pytest.raises(InvalidValueError, match=r"count = 1\.5 is not allowed: must be a whole number"):
        check_fields(Options(count=1.5))  # pyright: ignore[reportArgumentType]
