"""What was mistyped on a command line, and what was probably meant."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable, Sequence

from sprintlab.core.errors import SprintlabError, printable


def did_you_mean(word: str, known: Iterable[str], otherwise: str, most: int = 2) -> str:
    """``did you mean ...?`` with the nearest names, or what to do where none is near."""
    near = difflib.get_close_matches(word, list(known), n=most, cutoff=0.5)
    return f"did you mean {' or '.join(near)}?" if near else otherwise


def refuse_unknown_option(command: str, words: Sequence[str], help_text: str) -> None:
    """Name the nearest option where the first unknown one was typed.

    Args:
        command: its name, for the message.
        words: that follow it.
        help_text: what ``--help`` of the command prints; every option begins a line of it.

    Raises:
        SprintlabError: one of the words is an option that the help does not list.
    """
    known = set(re.findall(r"(?<![\w-])--[a-z][\w.-]*", help_text))
    for word in words:
        option = word.partition("=")[0].replace("_", "-")
        if option.startswith("--") and option not in {name.replace("_", "-") for name in known}:
            hint = did_you_mean(option, known, f"sprintlab {command} --help lists all", most=1)
            raise SprintlabError(f"{command} has no option {printable(option)}: {hint}")
