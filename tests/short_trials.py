"""Trials of a twentieth of their cost, for tests that look at what is made of their results."""

from collections.abc import Callable, Mapping
from typing import Any

from sprintlab.commands import SpeedProfile, SprintProfile
from sprintlab.evaluation.protocol import ProtocolSettings
from sprintlab.evaluation.trial import SprintCourse
from sprintlab.plant import PlantOptions

DEFAULTS = {
    ProtocolSettings: {"hold": 0.5},
    PlantOptions: {"timestep": 0.0005, "contact_time_constant": 0.001, "motor_rate": 500.0},
    SpeedProfile: {"stand": 0.5, "rest": 1.5},  # half a second to come to rest, one at rest
    SprintProfile: {"stand": 0.5},
    SprintCourse: {"rest": 1.5},
}

BRIEF = {
    SpeedProfile: {"stand": 0.3, "rest": 0.2},
    SprintProfile: {"stand": 0.3},
    SprintCourse: {"rest": 0.2},
}
"""Hardly more than the hold, for the second engine: ten times as slow as the first."""

COARSE = PlantOptions(**DEFAULTS[PlantOptions])
"""The plant of short trials, for settings that are made when a test file is read."""


def shorten_trials(
    change: Callable[[dict[str, Any], str, Any], None] = dict.__setitem__,
    defaults: Mapping[type, Mapping[str, Any]] = DEFAULTS,
) -> None:
    """Change what trials are by default, in this process and in those that it sends requests to."""
    for options, values in defaults.items():
        for name, value in values.items():
            change(options.__init__.__kwdefaults__, name, value)
