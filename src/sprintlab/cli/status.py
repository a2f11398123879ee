"""Exit status of a command, and the one sentence that every expected failure is on stderr."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable

from sprintlab.cli.interruptions import tidy_termination
from sprintlab.core.errors import SprintlabError, printable

REFUSED = 2
INTERRUPTED = 130


def exit_status(program: str, work: Callable[[], int]) -> int:
    """Do a command's work and return its exit status; no expected failure shows a traceback.

    Args:
        program: name that begins the sentence on stderr.
        work: parses and runs; returns the status where nothing fails.
    """
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
