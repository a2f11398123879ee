"""Every field of the settings counts in their hash."""

from __future__ import annotations

from dataclasses import fields, is_dataclass, replace
from typing import Any

import pytest

pytest.importorskip("torch")

from sprintlab.training.settings import TrainingSettings


def changed(value: Any) -> Any:
    """Another value of the same kind."""
    if isinstance(value, bool):
        return not value
    if isinstance(value, int | float):
        return value + 1
    if isinstance(value, str):
        return value + "x"
    return (*value[:-1], changed(value[-1])) if isinstance(value, tuple) and value else None


def places(settings: Any, path: tuple[str, ...] = ()) -> list[tuple[str, ...]]:
    """Dotted paths of all fields that can be changed."""
    found: list[tuple[str, ...]] = []
    for item in fields(settings):
        value = getattr(settings, item.name)
        inner = places(value, (*path, item.name)) if is_dataclass(value) else None
        found += [(*path, item.name)] if inner is None and changed(value) is not None else inner or []
    return found


def with_changed(settings: Any, path: tuple[str, ...]) -> Any:
    """The settings with one field changed, whatever their checks say."""
    copy, (name, *rest) = replace(settings), path
    value = getattr(settings, name)
    object.__setattr__(copy, name, with_changed(value, tuple(rest)) if rest else changed(value))
    return copy


def test_every_field_counts() -> None:
    settings = TrainingSettings()
    paths = places(settings)
    assert len(paths) > 100
    digests = {with_changed(settings, path).digest() for path in paths}
    assert len(digests | {settings.digest()}) == len(paths) + 1
