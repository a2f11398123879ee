"""The page of all commands, written from the functions behind them."""

from __future__ import annotations

import dataclasses
import inspect
import re
import textwrap
from collections.abc import Iterator
from typing import Any

from sprintlab.cli.main import ALL, typed

HEAD = """# Commands

Every command answers `--help`. Commands that print numbers take `--json` and then print JSON only. The exit
status is 0 when the command did its work, 1 when a robot fell or was stopped in it (`run`, `robot-sim`), 2
when it was refused (one sentence on stderr says why) and 130 when it was interrupted. Results go to stdout,
remarks and progress to stderr; colours appear on a terminal only.
"""


def command_reference() -> str:
    """The page as Markdown."""
    return "\n".join([HEAD, *_sections("sprintlab", ALL)])


def _sections(name: str, command: Any) -> Iterator[str]:
    if isinstance(command, dict):
        for part, member in command.items():
            yield from _sections(f"{name} {part}", member)
        return
    kind = typed(command)
    yield f"## {name}\n\n{_escaped(described(kind)[0])}\n"
    yield "| argument | default | meaning |\n|---|---|---|\n" + "\n".join(_rows(kind)) + "\n"


def described(kind: type) -> tuple[str, dict[str, str]]:
    """What a docstring says: the text before ``Attributes:`` or ``Args:``, and the meaning of each."""
    text = inspect.cleandoc(kind.__doc__ or "")
    summary, attributes, *_ = [*re.split(r"^(?:Attributes|Args|Raises):$", text, flags=re.MULTILINE), ""]
    meanings: dict[str, str] = {}
    for entry in re.split(r"\n(?=\S)", textwrap.dedent(attributes.strip("\n"))):
        name, _, meaning = " ".join(entry.split()).partition(": ")
        meanings[name] = meaning
    return " ".join(summary.split()), meanings


def _rows(kind: Any) -> Iterator[str]:
    """A row a parameter; those that are groups of options stand as their own fields, without a prefix."""
    meanings = described(kind)[1]
    for field in dataclasses.fields(kind):
        if dataclasses.is_dataclass(field.default):
            yield from _rows(type(field.default))
            continue
        notes = [note.help for note in getattr(field.type, "__metadata__", ()) if getattr(note, "help", None)]
        meaning = _escaped(notes[0] if notes else meanings.get(field.name, "")).replace("|", chr(92) + "|")
        dashed = field.name.replace("_", "-")
        option = f"--no-{dashed}" if field.default is True else f"--{dashed}"
        shown = field.name.upper() if "Positional" in repr(field.type) else option
        yield f"| `{shown}` | {_default_text(field)} | {meaning} |"


def _escaped(text: str) -> str:
    """Placeholders such as <date> as text: Markdown would take them for HTML."""
    return text.replace("<", "&lt;")


def _default_text(field: dataclasses.Field[Any]) -> str:
    value = field.default
    if value is dataclasses.MISSING:
        return "required"
    return "" if value is None or isinstance(value, bool) or value == () else f"`{value}`"


if __name__ == "__main__":
    print(command_reference())
