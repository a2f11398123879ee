"""Settings as text: what is written is read back equal, and each refusal names the setting."""

from __future__ import annotations

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
        [
            "ppo.steps=8",
            "schedule.kind=UniformSchedule",
            "actuator_model=square",
            "stages.record_margin=none",
        ],
    )
    assert (changed.ppo.steps, changed.stages.record_margin, changed.actuator_model) == (8, None, "square")
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
        ("ppo.steps=1.5", r"ppo\.steps = 1\.5.*must be a whole number"),
        ("ppo.step=3", r"ppo\.step = 3.*no such setting, choose among steps"),
        ("schedule.kind=Spiral", r"schedule\.kind = 'Spiral'.*UniformSchedule"),
        ("ppo=3", "must be PpoSettings"),
        ("actuator_model=round", "refined.*square"),
        ("ppo.learning_rate=-1", r"ppo\.learning_rate = -1"),
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
    with pytest.raises(SprintlabError, match=r"reward\.progress\.parameters = .*height.*progress.*speed"):
        with_changes(method(), ["reward.progress.height=1"])
    with pytest.raises(SprintlabError, match=r"reward\.effort.*must say function, weight"):
        with_changes(method(), ["reward.effort.weight=1"])
