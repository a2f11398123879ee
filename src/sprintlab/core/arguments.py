"""Arguments of public functions: checked against the signature, and refused by name in one sentence.

Without this, a speed read from JSON as text raises an obscure TypeError, sometimes after hours of work.
"""

from __future__ import annotations

import functools
import inspect
import math
import types
from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields
from numbers import Integral, Real
from pathlib import Path
from typing import Any, Literal, ParamSpec, TypeVar, Union, cast, get_args, get_origin, get_type_hints

from sprintlab.core.errors import InvalidValueError

P = ParamSpec("P")
R = TypeVar("R")

_WORDS: dict[Any, str] = {
    int: "a whole number", float: "a finite number", str: "text", bool: "True or False",
    Path: "a name or path", types.NoneType: "None",
}  # fmt: skip


def checked(function: Callable[P, R]) -> Callable[P, R]:
    """The function, with its arguments compared with its type hints before it begins.

    Hints that only type checkers can look up are left out.

    Raises:
        InvalidValueError: when called with an argument of another kind; it is named.
    """
    signature = inspect.signature(function)

    @functools.wraps(function)
    def call(*args: P.args, **kwargs: P.kwargs) -> R:
        hints = _hints(function)
        for name, value in signature.bind(*args, **kwargs).arguments.items():
            if value is not signature.parameters[name].default:
                check_kind(name, value, hints.get(name, Any))
        return function(*args, **kwargs)

    return call


def check_fields(settings: Any) -> None:
    """Compare the fields of a dataclass with their type hints. Raises as ``check_kind``."""
    hints = get_type_hints(settings.__class__)
    for field in fields(settings):
        check_kind(field.name, getattr(settings, field.name), hints[field.name])


def check_kind(name: str, value: object, hint: Any) -> None:
    """Refuse a value that is not of the kind of a type hint.

    NumPy's numbers count as numbers, whole ones as floats, and text as a path.

    Raises:
        InvalidValueError: it is of another kind, or not a finite number.
    """
    if not _fits(value, hint):
        raise InvalidValueError(name, value, f"must be {_described(hint)}")


@functools.cache
def _hints(function: Callable[..., Any]) -> dict[str, Any]:
    space, found = getattr(function, "__globals__", {}), dict[str, Any]()
    for name, hint in function.__annotations__.items():
        try:
            found |= get_type_hints(types.SimpleNamespace(__annotations__={name: hint}), space)
        except NameError:
            continue
    return found


def _fits(value: Any, hint: Any) -> bool:
    origin, inner = get_origin(hint), get_args(hint)
    if hint is Any:
        return True
    if origin in (Union, types.UnionType):
        return any(_fits(value, one) for one in inner)
    if origin is Literal:
        return isinstance(value, str)  # which ones, the function says itself
    if origin is Mapping:
        return isinstance(value, Mapping) and all(_fits(key, inner[0]) for key in cast("Any", value))
    if origin in (Sequence, tuple):
        items = cast("Sequence[Any]", value)
        array = getattr(items, "ndim", 0) > 0  # NumPy itself is too heavy to be imported for every command
        listed = array or (isinstance(value, Sequence) and not isinstance(value, str | bytes))
        return listed and all(_fits(one, inner[0]) for one in items)
    if origin is Callable:
        return callable(value)
    if hint is bool:
        return type(value).__name__ in ("bool", "bool_")  # Python's or NumPy's
    if hint is Path:
        return isinstance(value, str | Path)
    if hint in (int, float):
        number: Any = Integral if hint is int else Real
        return type(value) is not bool and isinstance(value, number) and bool(abs(value) < math.inf)
    return not isinstance(hint, type) or isinstance(value, hint)


def _described(hint: Any) -> str:
    """What an argument may be, in words."""
    origin, inner = get_origin(hint), get_args(hint)
    if origin in (Union, types.UnionType):
        return " or ".join(_described(one) for one in inner if one is not str or Path not in inner)
    if origin is Literal:
        return "one of " + ", ".join(map(str, inner))
    if origin in (Sequence, tuple):
        return f"a list, each {_described(inner[0])}"
    if origin is Mapping:
        return "a mapping of names to values"
    return _WORDS.get(hint) or f"an instance of {getattr(hint, '__name__', hint)}"
