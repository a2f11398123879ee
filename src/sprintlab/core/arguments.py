"""Arguments of public functions: compared with the signature, and refused by name in one sentence.

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
_hints = functools.cache(get_type_hints)

_WORDS: dict[Any, str] = {
    int: "a whole number", float: "a finite number", str: "text", bool: "True or False",
    Path: "a path", types.NoneType: "None", Mapping: "a table", dict: "a table", Callable: "a function",
}  # fmt: skip


def checked(function: Callable[P, R]) -> Callable[P, R]:
    """The function, with its arguments compared with its type hints before it begins."""
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
    """Compare the fields of a dataclass with their type hints."""
    hints = _hints(settings.__class__)
    for field in fields(settings):
        check_kind(field.name, getattr(settings, field.name), hints[field.name])


def check_kind(name: str, value: object, hint: Any) -> None:
    """Refuse a value that is not of the kind of a type hint. Raises ``InvalidValueError``.

    NumPy's numbers count as numbers, whole ones as floats, and text as a path.
    """
    if not _fits(value, hint):
        raise InvalidValueError(name, value, f"must be {in_words(hint)}")


def in_words(hint: Any) -> str:
    """What a type hint allows: ``a whole number or None``, ``a list of 2, each a finite number``."""
    kind, inner = get_origin(hint) or hint, get_args(hint)
    if kind in (Union, types.UnionType):
        return " or ".join(map(in_words, inner))
    if kind is Literal:
        return f"one of {', '.join(map(str, inner))}"
    if kind in (Sequence, tuple):
        count = "" if kind is Sequence or inner[-1] is Ellipsis else f" of {len(inner)}"
        return f"a list{count}, each {in_words(inner[0])}"
    return _WORDS.get(kind) or kind.__name__


def _fits(value: Any, hint: Any) -> bool:
    kind, inner = get_origin(hint) or hint, get_args(hint)
    if kind in (Union, types.UnionType):
        return any(_fits(value, one) for one in inner)
    if kind is Literal:
        return isinstance(value, str)  # which ones, the function says itself
    if kind in (Sequence, tuple):
        array = getattr(value, "ndim", 0) > 0  # NumPy itself is too heavy to be imported for every command
        listed = array or (isinstance(value, Sequence) and not isinstance(value, str | bytes))
        return listed and all(_fits(one, inner[0]) for one in cast("Sequence[Any]", value))
    if kind is bool:
        return type(value).__name__ in ("bool", "bool_")  # Python's or NumPy's
    if kind is Path:
        return isinstance(value, str | Path)
    if kind in (int, float):
        number: Any = Integral if kind is int else Real
        return type(value) is not bool and isinstance(value, number) and bool(abs(value) < math.inf)
    return kind is Any or not isinstance(kind, type) or isinstance(value, kind)
