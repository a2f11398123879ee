"""Settings by their dotted names, the same in ``sprintlab train``, ``sweep`` and a run's file: ``ppo.steps``.

Nothing here needs PyTorch. A setting is replaced by a value of its own kind or refused by name; a part that
may be absent, such as the battery, is ``"none"`` in a file, since TOML has no word for it.
"""

from __future__ import annotations

import difflib
import json
import re
import types
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields, is_dataclass, replace
from pathlib import Path
from typing import Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

from sprintlab.core.errors import InvalidValueError, SprintlabError

ABSENT = "none"
"""What a file says where Python has ``None``."""
KIND = "kind"
"""Key that says which of several kinds a part is, e.g. ``schedule.kind``."""
_Settings = TypeVar("_Settings")


def override(settings: _Settings, name: str, value: Any) -> _Settings:
    """``settings`` with the setting of a dotted name replaced; errors as in ``replaced``."""
    for part in reversed(name.split(".")):
        value = {part: value}
    return replaced(settings, value)


def replaced(settings: Any, values: Mapping[str, Any], place: str = "") -> Any:
    """``settings`` with nested values in place, all at once: what belongs together is checked together.

    A part such as the battery, ``None`` by default, begins with its own defaults where one of its settings is
    named; a mapping sets several, and an empty one none: the part is then there as it comes.

    Args:
        settings: a frozen dataclass.
        values: names of its fields to values; those of a part in a mapping of their own.
        place: dotted name of ``settings``, for messages.

    Raises:
        InvalidValueError: there is no such setting, the value is of another kind, or the settings refuse it.
    """
    changes = {name: _replacement(settings, name, value, place) for name, value in values.items()}
    try:
        return replace(settings, **changes)
    except InvalidValueError as error:
        own = error.field.removeprefix(f"{place.rpartition('.')[2]}.")
        raise InvalidValueError(_joined(place, own), error.value, error.allowed) from error


def plain(settings: Any) -> dict[str, Any]:
    """Nested values as a TOML file can hold them; ``replaced`` puts the same settings together again."""
    hints = get_type_hints(type(settings))
    return {name: _plain(getattr(settings, name), hints[name]) for name in hints}


def _plain(value: Any, hint: Any) -> Any:
    if value is None:
        return ABSENT
    if is_dataclass(value):
        kind = {KIND: dashed(type(value).__name__)} if len(_parts(hint)) > 1 else {}
        return {**kind, **plain(value)}
    if isinstance(value, tuple):
        return list(value)
    return str(value) if isinstance(value, Path) else value


def _replacement(settings: Any, name: str, value: Any, place: str) -> Any:
    full = _joined(place, name)
    known = [field.name for field in fields(settings)]
    if name not in known:
        raise InvalidValueError(full, value, unknown_setting(name, known, place))
    present, hint = getattr(settings, name), get_type_hints(type(settings))[name]
    if not isinstance(value, Mapping):
        return _of_kind(full, present, value, hint)
    part, values = _begun(full, present, value, hint)
    if not is_dataclass(part):
        raise InvalidValueError(full, dict(value), f"must be {_described(hint)}: it has no parts")
    return replaced(part, values, full)


def unknown_setting(name: str, known: Sequence[str], place: str = "") -> str:
    """What is allowed where a name is not known: the nearest one, else all."""
    near = difflib.get_close_matches(name, known, n=2, cutoff=0.6)
    if near:
        return f"there is no such setting, did you mean {' or '.join(_joined(place, each) for each in near)}?"
    return f"there is no such setting here, choose among {', '.join(known)}"


def _begun(name: str, present: Any, values: Mapping[str, Any], hint: Any) -> tuple[Any, Mapping[str, Any]]:
    """The part that ``values`` change, and those of them that it has as settings."""
    parts = {dashed(part.__name__): part for part in _parts(hint)}
    if len(parts) < 2 or KIND not in values:
        first = next(iter(parts.values()), None)
        return (first() if present is None and first else present), values
    kind = values[KIND]
    if not isinstance(kind, str) or kind not in parts:
        raise InvalidValueError(f"{name}.{KIND}", kind, f"choose one of {', '.join(parts)}")
    part = present if type(present) is parts[kind] else parts[kind]()
    return part, {key: value for key, value in values.items() if key != KIND}


def _of_kind(name: str, present: Any, value: Any, hint: Any) -> Any:
    """``value`` as the number, text or list that may stand there."""
    if hint is Any:  # a number or an array of them: what stands there says which
        hint = type(present)
    kinds = [kind for kind in kinds_of(hint) if not is_dataclass(kind)]
    for kind in sorted(kinds, key=lambda kind: kind is not types.NoneType):
        try:
            return _converted(value, kind)
        except TypeError:
            continue
    raise InvalidValueError(name, value, f"must be {_described(hint)}")


def _converted(value: Any, kind: Any) -> Any:
    """``value`` as an instance of a type; raises ``TypeError`` where it is of another kind."""
    if get_origin(kind) is tuple and isinstance(value, (list, tuple)):
        inner = get_args(kind)
        inner = inner[:1] * len(value) if inner[-1] is Ellipsis else inner
        if len(inner) == len(value):
            return tuple(_converted(each, one) for each, one in zip(value, inner, strict=True))
    if kind is types.NoneType and (value is None or value == ABSENT):
        return None
    if kind is float and type(value) is int:
        return float(value)
    if kind is Path and isinstance(value, (str, Path)):
        return Path(value)
    if type(value) is (str if get_origin(kind) is Literal else kind):
        return value
    raise TypeError


def kinds_of(hint: Any) -> tuple[Any, ...]:
    """The types that a type hint allows."""
    return get_args(hint) if get_origin(hint) in (Union, types.UnionType) else (hint,)


def _parts(hint: Any) -> list[Any]:
    """The dataclasses among them."""
    return [kind for kind in kinds_of(hint) if is_dataclass(kind)]


_WORDS = {int: "a whole number", float: "a number", str: "text", bool: "true or false", Path: "a path"}


def _described(hint: Any) -> str:
    """What a setting may be, in words."""
    return " or ".join(_word(kind) for kind in kinds_of(hint))


def _word(kind: Any) -> str:
    if kind is types.NoneType:
        return f'"{ABSENT}"'
    if is_dataclass(kind):
        return f"a table of {', '.join(field.name for field in fields(kind))}"
    if get_origin(kind) is Literal:
        return f"one of {', '.join(get_args(kind))}"
    if get_origin(kind) is tuple:
        inner = get_args(kind)
        count = "" if inner[-1] is Ellipsis else f"{len(inner)} "
        return f"a list of {count}{_word(inner[0]).split()[-1]}s"
    return _WORDS.get(kind, getattr(kind, "__name__", str(kind)))


def choices(settings: Any, prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Parts that may be of several kinds, or none: dotted name, outer ones first, and what stands there."""
    for name, hint in get_type_hints(type(settings)).items():
        part = getattr(settings, name)
        if len(kinds_of(hint)) > 1 and _parts(hint):
            yield f"{prefix}{name}", part
        if is_dataclass(part):
            yield from choices(part, f"{prefix}{name}.")


def dashed(name: str) -> str:
    """``AdaptiveSchedule`` as ``adaptive-schedule``."""
    return re.sub(r"(?<=[a-z])(?=[A-Z])", "-", name).lower()


def read_value(text: str) -> Any:
    """A value as somebody typed it: JSON where it is that, ``None`` for "none", else text."""
    if text == ABSENT:
        return None
    try:
        return json.loads(text)
    except ValueError:
        return text


def parse_assignments(assignments: Sequence[str]) -> dict[str, Any]:
    """``["ppo.steps=16"]`` as a mapping.

    Raises:
        SprintlabError: an assignment without ``=``.
    """
    return {name: read_value(text) for name, text in map(split_assignment, assignments)}


def split_assignment(assignment: str) -> tuple[str, str]:
    """``"ppo.steps=16"`` as name and text. Raises ``SprintlabError`` where there is no ``=``."""
    name, equals, text = assignment.partition("=")
    if not (equals and name and text):
        raise SprintlabError(f"{assignment!r} is no assignment; expected e.g. ppo.steps=16")
    return name, text


def _joined(place: str, name: str) -> str:
    return f"{place}.{name}" if place else name
