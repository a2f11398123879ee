"""What every command prints with: tables on stdout, progress on stderr, colours only on a terminal."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from inspect import signature
from pathlib import Path
from typing import Any, TypeVar

from rich.console import Console

from sprintlab.api.tables import PLAIN_WIDTH, Drawn, PlainConsole, Printed
from sprintlab.api.tables import plain_table as plain_table
from sprintlab.api.tables import styled as styled
from sprintlab.core.errors import SprintlabError, UnwrittenError
from sprintlab.core.files import check_figure_path
from sprintlab.core.json_values import json_ready

Result = TypeVar("Result", bound=Printed)


def stdout_console() -> Console:
    """A console for results; wide when piped, so that tables keep their columns."""
    return PlainConsole(width=None if sys.stdout.isatty() else PLAIN_WIDTH, highlight=False, markup=False)


def stderr_console() -> Console:
    """A console for progress and remarks."""
    return PlainConsole(stderr=True, highlight=False, markup=False)


def print_json(data: Any) -> None:
    """JSON and nothing else on stdout; what is not finite, which a file may hold, is null."""
    print(json.dumps(json_ready(data), indent=2, allow_nan=False))


def arguments(command: Any) -> dict[str, Any]:
    """A command's fields but ``figure`` and ``json``, as arguments of a function of the API.

    Raises:
        InvalidValueError: the figure could not be drawn at the end; said before any work.
    """
    check_figure_path(getattr(command, "figure", None))
    return {name: value for name, value in vars(command).items() if name not in ("figure", "json")}


def measure(function: Callable[..., Result], command: Any) -> Result:
    """Call a function of the API with a command's fields as its arguments; print and draw what it finds.

    A result is not lost with its files or its picture, for which the disk may have become too full, nor with
    a reader of stdout that has left.

    Args:
        function: that takes by their names all fields but ``figure`` and ``json``, and maybe ``progress``.
        command: with these two as well: picture to draw, if it offers one, and whether to print JSON only.

    Raises:
        SprintlabError: the picture cannot be drawn there, or what the function raises.
    """
    options = arguments(command)
    try:
        with progress_bar(quiet=command.json) as report:
            report("loading", None)
            told = {"progress": report} if "progress" in signature(function).parameters else {}
            found = function(**options, **told)
    except UnwrittenError as error:
        if isinstance(error.found, Printed):
            with suppress(SprintlabError):  # a picture that finds no room either
                _show_and_draw(error.found, command)
        raise
    _show_and_draw(found, command)
    return found


def _show_and_draw(found: Printed, command: Any) -> None:
    try:
        show(found, command)
    finally:
        draw(found, getattr(command, "figure", None))


def show(found: Printed, command: Any, **files: Path | None) -> None:
    """Print a result as a command's ``json`` says, and name the files that were written.

    Args:
        found: the result.
        command: says whether to print JSON only, and which figure was drawn, if it offers one.
        files: that were written besides, by what they are.
    """
    figure = getattr(command, "figure", None)
    if command.json:
        drawn = {"figure": None if figure is None else str(figure)} if "figure" in vars(command) else {}
        print_json({**found.to_dict(), **drawn})
        return
    stdout_console().print(found, soft_wrap=True)
    show_files(**files, figure=figure)


def draw(found: Printed, figure: Path | None) -> None:
    """Draw a result, if a figure is asked for and the result offers one."""
    if figure is not None and isinstance(found, Drawn):
        from sprintlab.core.theme import save_figure

        save_figure(figure, found.plot())


def show_files(**paths: Path | None) -> None:
    """Say where files were written, each under its name."""
    for name, path in paths.items():
        if path is not None:
            stdout_console().print(f"{name.replace('_', ' ')}: {path}", soft_wrap=True)


LINE_SECONDS = 10.0
"""Least time between two lines of progress where stderr is not a terminal [s]."""


@contextmanager
def progress_bar(quiet: bool = False) -> Iterator[Callable[[str, float | None], None]]:
    """Yield ``report(what, share)``, shown on stderr: a bar on a terminal, elsewhere a line now and then.

    Args:
        quiet: show nothing.

    Yields:
        A function of a text and the share done, 0 to 1; ``None`` where it is not known.
    """
    console = stderr_console()
    if quiet or not console.is_terminal:
        yield _ignored if quiet else _LinesOfProgress(console)
        return
    from rich.progress import (
        BarColumn,
        Progress,
        SpinnerColumn,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    bar = Progress(
        SpinnerColumn(),
        TextColumn("{task.description:<34}", markup=False),
        BarColumn(),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
        console=console,
        transient=True,
    )
    with bar:
        task = bar.add_task("starting", total=None)

        def report(what: str, share: float | None) -> None:
            if share is None:
                bar.update(task, description=what, total=None)
            else:
                bar.update(task, description=what, total=1.0, completed=min(max(share, 0.0), 1.0))

        yield report


def _ignored(what: str, share: float | None) -> None:
    """Show nothing."""


class _LinesOfProgress:
    """Progress as lines: what is being done, the share done, and about how long the rest takes."""

    def __init__(self, console: Console) -> None:
        self._console, self._what = console, ""
        self._begun = self._shown = time.monotonic()

    def __call__(self, what: str, share: float | None) -> None:
        """Print a line unless the last one is younger than ``LINE_SECONDS``."""
        now = time.monotonic()
        if what != self._what:
            self._what, self._begun = what, now
        if now - self._shown < LINE_SECONDS:
            return
        self._shown = now
        rest = "" if not share else f", about {(now - self._begun) * (1.0 - share) / share:.0f} s left"
        self._console.print(
            what + ("" if share is None else f": {100.0 * share:.0f} %{rest}"), soft_wrap=True
        )
