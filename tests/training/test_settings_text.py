"""Settings as text and as a hash: what is written is read back equal, and each refusal names the setting."""

from __future__ import annotations

from dataclasses import fields, is_dataclass, replace
from typing import Any

import pytest

from sprintlab.commands import UniformSchedule
from sprintlab.core.errors import SprintlabError
from sprintlab.core.reading import parse_toml
from sprintlab.training.environment import rewards
from sprintlab.training.methods import ALL_METHODS, method
from sprintlab.training.settings import TrainingSettings
from sprintlab.training.settings_text import from_plain, read_settings, settings_toml, with_changes


@pytest.mark.parametrize("name", sorted(ALL_METHODS))
def test_what_is_written_is_read_back_equal(name: str) -> None:
    settings = method(name, robot="go2", seed=5)
    assert from_plain(TrainingSettings, parse_toml(settings_toml(settings))) == settings


def test_settings_are_changed_by_name() -> None:
    changed = with_changes(
        method(),
        ["ppo.steps=8", "schedule.kind=UniformSchedule", "actuator_model=square", "ppo.std_anneal=none"],
    )
    assert (changed.ppo.steps, changed.ppo.std_anneal, changed.actuator_model) == (8, None, "square")
    assert isinstance(changed.schedule, UniformSchedule)


def test_a_part_that_is_off_begins_with_its_defaults() -> None:
    heat = with_changes(method(), ["simulation.heat.ambient_temperature=30"]).simulation.heat
    assert heat is not None and heat.ambient_temperature == 30.0


def test_a_file_changes_what_it_names(tmp_path) -> None:
    path = tmp_path / "settings.toml"
    paper = method(preset="paper")
    path.write_text(settings_toml(paper))
    assert read_settings(path, method()) == paper  # no term of the default beside those of the file
    path.write_text("[ppo]\nsteps = 8\n")
    assert read_settings(path, method()) == with_changes(method(), {"ppo.steps": 8})
    path.write_text("[ppo]\nsteps = 0\n")
    with pytest.raises(SprintlabError, match=r"settings\.toml: ppo\.steps = 0"):
        read_settings(path, method())


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ("ppo.steps", "changes no setting"),
        ("ppo.steps=1.5", r"ppo\.steps = 1\.5.*a whole number"),
        ("ppo.step=3", r"did you mean ppo\.steps"),
        ("schedule.kind=Spiral", r"schedule\.kind = 'Spiral'.*UniformSchedule"),
        ("ppo=3", "a table of steps"),
        ("actuator_model=round", "one of refined"),
        ("ppo.initial_std=-1", r"ppo\.initial_std = -1"),
    ],
)
def test_a_refusal_names_the_setting(change: str, words: str) -> None:
    with pytest.raises(SprintlabError, match=words):
        with_changes(method(), [change])


def test_terms_are_changed_added_and_taken_away_by_name() -> None:
    changes = ["reward.progress.weight=2", "reward.foot_clearance.height=0.2", "reward.touchdown=none"]
    changes += [
        "reward.torque={function = 'torque', weight = [0, -1e-4]}",
        "randomization.friction.between=[1, 1]",
    ]
    changed = with_changes(method(), changes)
    assert changed.reward["progress"].weights == (2.0, 2.0)
    assert changed.reward["foot_clearance"].parameters == {"height": 0.2}
    assert "touchdown" not in changed.reward
    assert changed.reward["torque"].function is rewards.torque
    assert changed.randomization["friction"].parameters == {"between": (1.0, 1.0)}
    with pytest.raises(SprintlabError, match=r"reward\.progress\.height = 1\.0.*progress has speed"):
        with_changes(method(), ["reward.progress.height=1"])
    with pytest.raises(SprintlabError, match=r"reward\.effort.*must say all of function"):
        with_changes(method(), ["reward.effort.weight=1"])


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


def test_every_field_counts_in_the_hash() -> None:
    settings = TrainingSettings()
    paths = places(settings)
    assert len(paths) > 100
    digests = {with_changed(settings, path).digest() for path in paths}
    assert len(digests | {settings.digest()}) == len(paths) + 1
