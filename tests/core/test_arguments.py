"""Arguments are held against a function's type hints before it begins."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import pytest

from sprintlab.core.arguments import check_fields, checked
from sprintlab.core.errors import InvalidValueError

if TYPE_CHECKING:
    from nowhere import Unknown


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
    unknown: Unknown = None,
    **more: Any,
) -> Unknown:
    return "worked"


@pytest.mark.parametrize(
    "given",
    [
        {"name": Path("a")},
        {"count": 2},
        {"speed": 2},
        {"speed": np.float32(2.0)},
        {"video": np.bool_(True)},
        {"speeds": np.linspace(1.0, 2.0, 3)},
        {"options": Options()},
        {"unknown": 3},
    ],
)
def test_what_fits_goes_through(given):
    assert work(**given) == "worked"


@pytest.mark.parametrize(
    ("given", "allowed"),
    [
        ({"name": 0}, "a name or path"),
        ({"count": 1.5}, "a whole number"),
        ({"speed": math.nan}, "a finite number or None"),
        ({"speed": "1"}, "a finite number"),
        ({"video": "no"}, "True or False"),
        ({"speeds": 1.0}, "a list"),
        ({"speeds": [1.0, "2"]}, "each a finite number"),
        ({"changes": []}, "a mapping"),
        ({"engine": 3}, "one of mujoco, drake"),
        ({"options": {}}, "an instance of Options or None"),
        ({"progress": 1}, "must"),
    ],
    ids=lambda each: str(each)[:30],
)
def test_what_does_not_fit_is_refused_by_name(given, allowed):
    (name,) = given
    with pytest.raises(InvalidValueError, match=allowed) as refused:
        work(**given)
    assert refused.value.field == name


def test_an_argument_that_is_not_there_is_told_as_python_tells_it():
    @checked
    def needs(one: int) -> int:
        return one

    with pytest.raises(TypeError, match="missing a required argument"):
        needs()


def test_fields_of_settings_are_held_against_their_hints():
    check_fields(Options(count=2, place=Path("a")))
    with pytest.raises(InvalidValueError, match=r"count = 1\.5 is not allowed: must be a whole number"):
        check_fields(Options(count=1.5))  # pyright: ignore[reportArgumentType]
