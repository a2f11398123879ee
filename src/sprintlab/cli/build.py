"""Commands made of functions of the API, and commands that choose among others."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import MISSING, field, is_dataclass, make_dataclass
from pathlib import Path
from types import UnionType
from typing import Annotated, Any, Union, get_args, get_origin, get_type_hints

import tyro

from sprintlab.cli.output import measure

FIGURE = "picture to draw (.png, .pdf or .svg); none when left out."


def command(
    function: Callable[..., Any],
    *,
    positional: int = 1,
    required: str = "",
    repeated: str = "",
    names: Mapping[str, str] | None = None,
    figure: str = "",
    defaults: Mapping[str, Any] | None = None,
    status: Callable[[Any], int] = lambda found: 0,
) -> Any:
    """A command that calls a function of the API with what was typed, and prints what it finds.

    The function's parameters are the options, its docstring is the help.

    Args:
        function: returns a result that prints itself.
        positional: how many of its first parameters are typed without their names.
        required: parameter that has to be typed, although the function has a default for it.
        repeated: parameter of several values, whose option is typed once for each.
        names: what is typed for parameters that the command calls otherwise.
        figure: help of ``--figure``, where the result draws itself.
        defaults: of parameters that are others for who types than for who calls.
        status: the exit status that a result means.
    """
    options: list[tuple[str, Any, Any]] = []
    for place, (name, kind, usual) in enumerate(_parameters(function)):
        default = MISSING if name == required else (defaults or {}).get(name, usual)
        shape = tyro.conf.UseAppendAction[kind] if name == repeated else kind
        shape = tyro.conf.Positional[shape] if place < positional else shape
        if names and name in names:
            shape = Annotated[shape, tyro.conf.arg(name=names[name])]
        options.append((name, shape, field(default=default)))
    if figure:
        options.append(("figure", Annotated[Path | None, tyro.conf.arg(help=figure)], field(default=None)))
    options.append(("json", Annotated[bool, tyro.conf.arg(help="print JSON only.")], field(default=False)))
    return make_dataclass(
        function.__name__,
        options,
        namespace={"__doc__": function.__doc__, "run": lambda self: status(measure(function, self))},
        kw_only=True,
        frozen=True,
    )


def _parameters(function: Callable[..., Any]) -> Iterator[tuple[str, Any, Any]]:
    """Name, type and default of each parameter but ``progress``."""
    kinds = get_type_hints(function)
    for name, parameter in inspect.signature(function).parameters.items():
        if name != "progress":
            kind: Any = _typed(kinds[name])
            default: Any = MISSING if parameter.default is parameter.empty else parameter.default
            options = default is None and inspect.isclass(kind) and is_dataclass(kind)
            yield name, kind, kind() if options else default


def _typed(kind: Any) -> Any:
    """What is typed for a parameter: of the types that it takes the first, for a sequence any number."""
    if get_origin(kind) is Sequence:
        return tuple[_typed(get_args(kind)[0]), ...]
    if get_origin(kind) not in (Union, UnionType):
        return kind
    first, *others = get_args(kind)
    return first | None if type(None) in others and not is_dataclass(first) else first


def choice(commands: Mapping[str, Any]) -> Any:
    """The type of a choice among commands by their names."""
    named = (Annotated[kind, tyro.conf.subcommand(name=name)] for name, kind in commands.items())
    return Union[tuple(named)]  # noqa: UP007 (a tuple cannot be joined with |)


def group(summary: str, commands: Mapping[str, Any]) -> Any:
    """A command of subcommands, e.g. ``sprintlab motor``.

    Args:
        summary: what they are for, one sentence.
        commands: by their names.
    """
    return make_dataclass(
        "Group",
        [("command", choice(commands))],
        namespace={"__doc__": summary, "run": lambda self: self.command.run()},
        kw_only=True,
        frozen=True,
    )
