"""The page of all commands, written from the command line's own classes."""

from __future__ import annotations

import ast
import dataclasses
import inspect
import re
import textwrap
from collections.abc import Iterator
from typing import Annotated, Any, Union, get_args, get_origin, get_type_hints

from sprintlab.cli.main import Command

HEAD = """# Commands

Every command answers `--help`. Commands that print numbers take `--json` and then print JSON only. The exit
status is 0 when the command did its work, 1 when a robot fell or was stopped in it (`run`, `robot-sim`), 2
when it was refused (one sentence on stderr says why) and 130 when it was interrupted. Results go to stdout,
remarks and progress to stderr; colours appear on a terminal only.
"""


def command_reference() -> str:
    """The page as Markdown."""
    parts = [HEAD]
    for name, command in subcommands(Command):
        parts.extend(_sections(f"sprintlab {name}", command))
    return "\n".join(parts)


def subcommands(union: Any) -> Iterator[tuple[str, type]]:
    """Name and class of every member of a union of annotated subcommands, those of subcommands left out."""
    for member in get_args(union):
        if get_origin(member) is Annotated:
            command, *notes = get_args(member)
            names = [note.name for note in notes if getattr(note, "name", None)]
            if names:
                yield names[0], command


def nested(command: type) -> Any:
    """The union of subcommands that a command chooses from; ``None`` for a plain command."""
    hints = get_type_hints(command, include_extras=True)
    unions = [hint for hint in hints.values() if _is_union(hint) and list(subcommands(hint))]
    return unions[0] if unions else None


def _is_union(hint: Any) -> bool:
    return get_origin(hint) is Union or type(hint).__name__ == "UnionType"


def _sections(name: str, command: type) -> Iterator[str]:
    inner = nested(command)
    if inner is not None:
        for part, member in subcommands(inner):
            yield from _sections(f"{name} {part}", member)
        return
    yield f"## {name}\n\n{_escaped(described(command)[0])}\n"
    rows = list(_rows(command))
    if rows:
        yield "| argument | default | meaning |\n|---|---|---|\n" + "\n".join(rows) + "\n"
    if name == "sprintlab train":
        yield "Its options are those of the training run: `sprintlab train sprint --help` lists them.\n"


def described(command: type) -> tuple[str, dict[str, str]]:
    """What a docstring says: the text before ``Attributes:`` or ``Args:``, and the meaning of each."""
    text = inspect.cleandoc(command.__doc__ or "")
    summary, attributes, *_ = [*re.split(r"^(?:Attributes|Args|Raises):$", text, flags=re.MULTILINE), ""]
    meanings: dict[str, str] = {}
    for entry in re.split(r"\n(?=\S)", textwrap.dedent(attributes.strip("\n"))):
        name, _, meaning = " ".join(entry.split()).partition(": ")
        meanings[name] = meaning
    return " ".join(summary.split()), meanings


def _rows(command: type) -> Iterator[str]:
    """A row a field; fields that are groups of options stand as their own fields, without a prefix."""
    hints, meanings = get_type_hints(command, include_extras=True), described(command)[1]
    for field in dataclasses.fields(command):
        for note in _notes(hints[field.name]):
            meanings[field.name] = note.help or meanings.get(field.name, "")
        if dataclasses.is_dataclass(hints[field.name]):
            yield from _rows(hints[field.name])
        else:
            yield _row(field, hints[field.name], meanings)


def _row(field: dataclasses.Field[Any], hint: Any, meanings: dict[str, str]) -> str:
    shown = field.name.upper() if "Positional" in repr(hint) else _option_name(field, hint)
    if field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING:
        default = "required"
    else:
        default = _default_text(field.default)
    return f"| `{shown}` | {default} | {_escaped(meanings.get(field.name, '')).replace('|', chr(92) + '|')} |"


def _escaped(text: str) -> str:
    """Placeholders such as <date> as text: Markdown would take them for HTML."""
    return text.replace("<", "&lt;")


def _option_name(field: dataclasses.Field[Any], hint: Any) -> str:
    name = next((note.name for note in _notes(hint) if note.name), field.name.replace("_", "-"))
    return f"--no-{name}" if field.default is True else f"--{name}"


def _notes(hint: Any) -> list[Any]:
    """What is said to the parser about an argument beside its type."""
    return [note for note in getattr(hint, "__metadata__", ()) if hasattr(note, "help")]


def _default_text(value: Any) -> str:
    if value is None or isinstance(value, bool) or value == () or value is dataclasses.MISSING:
        return ""
    return f"`{ast.literal_eval(repr(value)) if isinstance(value, str) else value}`"


if __name__ == "__main__":
    print(command_reference())
