"""Settings as text: ``NAME=VALUE`` on a command line, TOML in a file, JSON in a checkpoint.

A name is dotted, ``ppo.steps``; a value is written as TOML. Each value must be of the kind that the setting
has, or is refused by its name. What may be absent, such as the heat of the windings, is ``"none"`` then. A
part of which there are several kinds, such as ``schedule``, has a key ``kind``: the name of its class.
Parameters of a term stand beside its function.
Nothing here needs PyTorch.
"""

from __future__ import annotations

import sys
import types
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any, TypeVar, Union, cast, get_args, get_origin, get_type_hints

import msgspec
import tomli_w

from sprintlab.core.arguments import in_words
from sprintlab.core.errors import InvalidValueError, SprintlabError
from sprintlab.core.reading import parse_toml, read_toml

ABSENT = "none"
KIND, PARAMETERS = "kind", "parameters"
_FUNCTIONS = ("sprintlab.training.environment.rewards", "sprintlab.training.environment.randomization")
"""Modules whose functions are named without them."""
Settings = TypeVar("Settings")


def with_changes(settings: Settings, changes: Iterable[str] | Mapping[str, Any]) -> Settings:
    """Settings with some of them changed, one after the other; what belongs together is checked together.

    Args:
        settings: a frozen dataclass.
        changes: ``["ppo.steps=8", "schedule.kind=UniformSchedule"]``, or a mapping of dotted names to values.
    """
    named = changes if isinstance(changes, Mapping) else dict(map(parse_assignment, changes))
    if not named:
        return settings
    plain: Any = to_plain(settings)
    for name, value in named.items():
        nested = _plain(value)
        for part in reversed(name.split(".")):
            nested = {part: nested}
        plain = _merged(plain, nested)
    return from_plain(type(settings), plain)


def _merged(old: Any, new: Any) -> Any:
    """``new`` over ``old``; a part of another kind or function takes the place of the old one."""
    if not (isinstance(old, dict) and isinstance(new, dict)):
        return new
    present, given = cast("dict[str, Any]", old), cast("dict[str, Any]", new)
    if any(given.get(key, present.get(key)) != present.get(key) for key in (KIND, "function")):
        return given
    return present | {name: _merged(present.get(name), value) for name, value in given.items()}


def parse_assignment(text: str) -> tuple[str, Any]:
    """``"ppo.steps=8"`` as name and value of TOML, where text needs no quotes."""
    name, value = split_assignment(text)
    try:
        return name, parse_toml(f"value = {value}")["value"]
    except ValueError:
        return name, value


def split_assignment(text: str) -> tuple[str, str]:
    """``"ppo.steps=8"`` as name and text. Raises ``SprintlabError`` where there is no ``=``."""
    name, equals, value = (part.strip() for part in text.partition("="))
    if not (equals and name and value):
        raise SprintlabError(f"{text!r} changes no setting; expected e.g. ppo.steps=8")
    return name.replace("-", "_"), value


def read_settings(path: Path, base: Settings) -> Settings:
    """``base`` with what a TOML file says in its place; one that says everything, as ``run.toml``, is all."""
    document, plain = read_toml(path, what="settings"), to_plain(base)
    whole = set(plain) <= set(document)
    try:
        return from_plain(type(base), document if whole else _merged(plain, document))
    except InvalidValueError as error:
        raise InvalidValueError(f"{path}: {error.field}", error.value, error.allowed) from error


def settings_toml(settings: object) -> str:
    """The settings as TOML, which ``read_settings`` reads."""
    return tomli_w.dumps(to_plain(settings))


def to_plain(settings: object) -> dict[str, Any]:
    """Nested dictionaries of numbers, texts and lists; ``from_plain`` makes the same settings of them."""
    hints = get_type_hints(type(settings))
    plain = {
        field.name: _plain(getattr(settings, field.name), hints[field.name])
        for field in fields(cast("Any", settings))
    }
    beside = plain.pop(PARAMETERS, {})
    return plain | beside


def from_plain(kind: type[Settings], values: Mapping[str, Any]) -> Settings:
    """Settings of a class from nested plain values; what is left out keeps its default."""
    return cast("Settings", _value(kind, values, ""))


# --- from settings to plain values -----------------------------------------------------------------------


def _plain(value: Any, hint: Any = None) -> Any:
    if value is None:
        return ABSENT
    if is_dataclass(value):
        kinds = _dataclasses(hint)
        kind = type(value)
        named = {} if kinds == [kind] else {KIND: kind.__name__ if kind in kinds else _path(kind)}
        return {**named, **to_plain(value)}
    if isinstance(value, Mapping):
        return {name: _plain(each, _entry(hint)) for name, each in cast("Mapping[str, Any]", value).items()}
    if isinstance(value, tuple | list):
        return [_plain(each) for each in cast("Sequence[Any]", value)]
    if callable(value):
        return _path(value)
    return value


def _path(value: Any) -> str:
    own = value.__module__ in _FUNCTIONS
    return value.__qualname__ if own else f"{value.__module__}:{value.__qualname__}"


# --- from plain values to settings -----------------------------------------------------------------------


def _value(hint: Any, value: Any, place: str) -> Any:
    """``value`` as an instance of what a type hint allows."""
    kinds, item = _kinds(hint), _entry(hint)
    if types.NoneType in kinds and value == ABSENT:
        return None
    if isinstance(value, Mapping):
        given = cast("Mapping[str, Any]", value)
        if item is not None:
            kept = {name: each for name, each in given.items() if each != ABSENT}
            return {name: _value(item, each, f"{place}.{name}") for name, each in kept.items()}
        if _dataclasses(hint):
            return _part(_chosen_class(_dataclasses(hint), given, place), given, place)
    if hint is Any and type(value) is int:  # numbers of a file that may be arrays
        return float(value)
    try:
        return msgspec.convert(value, hint, dec_hook=_function)
    except (msgspec.ValidationError, TypeError) as error:
        raise InvalidValueError(place, value, f"must be {in_words(hint)}") from error


def _function(_: type, value: Any) -> Any:
    """A function, or the one that a text names."""
    found = _imported(value) if isinstance(value, str) else value
    if not callable(found):
        raise ValueError("not a function")
    return found


def _part(kind: Any, values: Mapping[str, Any], place: str) -> Any:
    """A dataclass from its fields; those that are not named keep their defaults."""
    hints = get_type_hints(kind)
    known = [field.name for field in fields(kind)]
    found = dict[str, Any]({PARAMETERS: {}} if PARAMETERS in known else {})
    for name, value in values.items():
        full = f"{place}.{name}".lstrip(".")
        if name in known:
            found[name] = _value(hints[name], value, full)
        elif PARAMETERS in known:
            found[PARAMETERS][name] = _value(_entry(hints[PARAMETERS]), value, full)
        elif name != KIND:
            allowed = f"there is no such setting, choose among {', '.join(known)}"
            raise InvalidValueError(full, value, allowed)
    try:
        return kind(**found)
    except InvalidValueError as error:
        own = error.field.removeprefix(f"{place.rpartition('.')[2]}.")
        raise InvalidValueError(f"{place}.{own}".lstrip("."), error.value, error.allowed) from error
    except TypeError as error:  # a field without default is missing
        needed = ", ".join(field.name for field in fields(kind) if field.default is field.default_factory)
        allowed = f"no setting has this name; a new term must say {needed}"
        raise InvalidValueError(place, dict(values), allowed) from error


def _chosen_class(known: Sequence[Any], values: Mapping[str, Any], place: str) -> Any:
    """The class that ``kind`` names, one of those that are known or one that is imported."""
    name = values.get(KIND, known[0].__name__)
    found = next((kind for kind in known if kind.__name__ == name), None) or _imported(str(name))
    if isinstance(found, type) and is_dataclass(found):
        return found
    names = ", ".join(kind.__name__ for kind in known)
    raise InvalidValueError(f"{place}.{KIND}", name, f"choose one of {names}, or a class that is imported")


def _imported(path: str) -> Any:
    """What stands under ``"module:name"`` in a module that is already imported, else None."""
    module, colon, name = path.rpartition(":")
    for place in (module,) if colon else _FUNCTIONS:
        found: Any = sys.modules.get(place)
        for part in name.split("."):
            found = getattr(found, part, None)
        if found is not None:
            return found
    return None


# --- type hints ------------------------------------------------------------------------------------------


def _kinds(hint: Any) -> tuple[Any, ...]:
    """The types that a type hint allows."""
    return get_args(hint) if get_origin(hint) in (Union, types.UnionType) else (hint,)


def _dataclasses(hint: Any) -> list[Any]:
    return [kind for kind in _kinds(hint) if is_dataclass(kind)]


def _entry(hint: Any) -> Any:
    """Type of the entries of a dictionary; None for other types."""
    return next((get_args(kind)[1] for kind in _kinds(hint) if get_origin(kind) in (dict, Mapping)), None)
