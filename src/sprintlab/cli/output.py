"""What every command prints with: tables on stdout, progress on stderr, colours only on a terminal."""

from __future__ import annotations

import json
import os
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from rich.console import Console

from sprintlab.api.interruptions import tidy_termination
from sprintlab.api.results import PLAIN_WIDTH, PlainConsole, Progress, silent
from sprintlab.core.errors import SprintlabError, printable
from sprintlab.core.json_values import json_ready

REFUSED, INTERRUPTED = 2, 130
LINE_SECONDS = 10.0
"""Least time between two lines of progress where stderr is not a terminal [s]."""


def exit_status(program: str, work: Callable[[], int]) -> int:
    """Exit status of a command's work; an expected failure is one sentence on stderr after its name."""
    try:
        with tidy_termination():
            status = work()
        sys.stdout.flush()
        return status
    except KeyboardInterrupt:
        print(f"{program}: interrupted", file=sys.stderr)
        return INTERRUPTED
    except BrokenPipeError:
        # The reader of a pipe is gone (``| head``): nothing more is written, not even at interpreter exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except (SprintlabError, OSError) as error:
        print(f"{program}: {printable(' '.join(str(error).split()), longest=2000)}", file=sys.stderr)
        return REFUSED


def stdout_console() -> Console:
    """A console for results; wide when piped, so that tables keep their columns."""
    return PlainConsole(width=None if sys.stdout.isatty() else PLAIN_WIDTH, highlight=False, markup=False)


def print_json(data: Any) -> None:
    """JSON and nothing else on stdout; what is not finite, which a file may hold, is null."""
    print(json.dumps(json_ready(data), indent=2, allow_nan=False), flush=True)


@contextmanager
def progress_bar(quiet: bool = False) -> Iterator[Progress]:
    """Yield a ``Progress`` that is shown on stderr: a bar on a terminal, elsewhere a line now and then."""
    console = PlainConsole(stderr=True, highlight=False, markup=False)
    if quiet or not console.is_terminal:
        yield silent if quiet else _LinesOfProgress(console)
        return
    from rich import progress

    with progress.Progress(console=console, transient=True) as bar:
        task = bar.add_task("starting", total=None)

        def report(what: str, share: float | None) -> None:
            done = None if share is None else min(max(share, 0.0), 1.0)
            bar.update(task, description=what, total=None if done is None else 1.0, completed=done)

        yield report


class _LinesOfProgress:
    """Progress as lines: what is being done, the share done, and about how long the rest takes."""

    def __init__(self, console: Console) -> None:
        self._console, self._share = console, 0.0
        self._begun = self._shown = time.monotonic()

    def __call__(self, what: str, share: float | None) -> None:
        """Print a line unless the last one is younger than ``LINE_SECONDS``."""
        now = time.monotonic()
        if share is None or share < self._share:  # another piece of work begins
            self._begun = now
        self._share = share or 0.0
        if now - self._shown < LINE_SECONDS:
            return
        self._shown = now
        rest = "" if not share else f", about {(now - self._begun) * (1.0 - share) / share:.0f} s left"
        line = what if share is None else f"{what}: {100.0 * share:.0f} %{rest}"
        self._console.print(line, soft_wrap=True)
