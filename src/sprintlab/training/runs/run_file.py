"""A run's file, ``run.toml``: every choice of a training, written into its folder, read by ``--config``.

Options of the run and settings stand side by side under the names that ``sprintlab train`` has for them; a
part of the settings is a table, ``[ppo]``. What a file leaves out keeps its default. Where a run is put, on
which device, who else gets its curves, and whether it is taken up again is said anew each time, so it is not
written; and since a file may come from elsewhere, it cannot say where to write or send.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import tomli_w

from sprintlab.core.errors import InvalidValueError, printable
from sprintlab.core.reading import parse_toml, read_toml
from sprintlab.training.methods import ALL_METHODS, PRESETS, method_settings, preset_settings
from sprintlab.training.runs.named_settings import ABSENT, plain, replaced, unknown_setting
from sprintlab.training.runs.options import TrainOptions
from sprintlab.training.scaling import scaled_settings
from sprintlab.training.settings import TrainingSettings

RUN_FILE = "run.toml"
ENVIRONMENTS = "simulation.environments"
_CHANGED, _LONGEST_COMMAND = "changed: ", 2000
_BEGUN_WITH = (  # the checkpoint holds them, and a session that takes the run up changes none
    "method", "robot", "environments", "seed", "keep_schedule", "keep_motor_model",
)  # fmt: skip
_UNWRITTEN = ("output", "wandb", "device", "resume", "preset", "settings")
_REFUSED = {
    "output": "must be typed: --output FOLDER",
    "wandb": "must be typed: --wandb PROJECT",
    "settings": "its parts stand in the file themselves, e.g. [ppo]",
    "resume": "must be typed: --resume",
}
_OPTIONS = tuple(field.name for field in fields(TrainOptions) if field.name != "settings")
SETTINGS = tuple(field.name for field in fields(TrainingSettings) if field.name not in _OPTIONS)
"""First words of the settings' names; ``method`` and ``seed`` are options of the run."""


def read_run_file(path: Path) -> TrainOptions:
    """The options of a training as a file has them, everything else at its default.

    Raises:
        SprintlabError: the file cannot be read, or is not TOML.
        InvalidValueError: a name is unknown or must be typed, or a value is not allowed; both are named with
            the file.
    """
    document = read_toml(path, what="run file")
    try:
        return _options(document)
    except InvalidValueError as error:
        raise InvalidValueError(f"{path}: {error.field}", error.value, error.allowed) from error


def run_text(options: TrainOptions, settings: TrainingSettings, command_line: str) -> str:
    """The file of a run.

    Args:
        options: of the run.
        settings: as the run has them, with method and preset applied.
        command_line: as it was typed.
    """
    kept, chosen = _written(options), plain(settings)
    environments = chosen["simulation"].pop("environments")
    decided = method_settings(settings.method, settings) if settings.method in ALL_METHODS else settings
    kept |= {
        **{name: chosen[name] for name in ("method", "robot", "seed")},
        "environments": environments,
        "keep_schedule": decided.schedule != settings.schedule,
        "keep_motor_model": decided.actuator_model != settings.actuator_model,
    }
    head = [
        "Every choice of this training. To train it again:",
        f"    sprintlab train --config {RUN_FILE} --output NEW_FOLDER",
        _typed(command_line),
        f"hash of the settings, as in the policy's contract: {settings.digest()}",
    ]
    settings_part = {name: chosen[name] for name in SETTINGS}
    return "".join(f"# {line}\n" for line in head) + tomli_w.dumps({**kept, **settings_part})


def resumed_text(begun: str, options: TrainOptions, iteration: int, command_line: str) -> str:
    """The file of a run that is taken up again: as it began, and at its end what this session changes.

    Args:
        begun: the file as it is.
        options: of this session.
        iteration: at which it goes on.
        command_line: of this session.

    Raises:
        ValueError: the file is no TOML.
    """
    document = {**parse_toml(begun), **_changes(begun)}
    now = {name: value for name, value in _written(options).items() if name not in _BEGUN_WITH}
    changed = {name: value for name, value in now.items() if document.get(name) != value}
    if not changed:
        return begun
    said = [_typed(command_line), *(f"{_CHANGED}{line}" for line in tomli_w.dumps(changed).splitlines())]
    lines = [f"resumed at iteration {iteration}, from there on:", *said]
    return f"{begun.rstrip()}\n\n" + "".join(f"# {line}\n" for line in lines)


def _written(options: TrainOptions) -> dict[str, Any]:
    return {name: value for name, value in plain(options).items() if name not in _UNWRITTEN}


def _typed(command_line: str) -> str:
    """A comment of TOML holds no control characters, and no line that is read is long."""
    return f"typed: {printable(' '.join(command_line.split()), _LONGEST_COMMAND)}"


def _changes(text: str) -> dict[str, Any]:
    """What earlier sessions that took the run up changed."""
    head = f"# {_CHANGED}"
    lines = [line.removeprefix(head) for line in text.splitlines() if line.startswith(head)]
    return {name: value for line in lines for name, value in parse_toml(line).items()}


def _options(document: Mapping[str, Any]) -> TrainOptions:
    for name, value in document.items():
        if name in _REFUSED and (name, value) != ("wandb", ABSENT):  # as files of older versions say
            raise InvalidValueError(name, value, _REFUSED[name])
        if name not in (*_OPTIONS, *SETTINGS):
            raise InvalidValueError(name, value, unknown_setting(name, (*_OPTIONS, *SETTINGS)))
    given = {name: value for name, value in document.items() if name in SETTINGS}
    simulation = given.get("simulation")
    if isinstance(simulation, Mapping) and "environments" in simulation:
        raise InvalidValueError(ENVIRONMENTS, simulation["environments"], "write environments at the top")
    asked = replaced(TrainOptions(), {name: document[name] for name in _OPTIONS if name in document})
    base = preset_settings(asked.preset)
    if asked.robot is not None:
        base = scaled_settings(asked.robot, base, base)  # what the file says itself is not scaled
    options = replace(asked, robot=None, preset=PRESETS[0], settings=replaced(base, given))
    options.check_kept(given, "write {name} = true to keep yours")
    return options
