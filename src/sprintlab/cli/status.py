"""Exit status of a command, and the one sentence that every expected failure is on stderr."""

from __future__ import annotations

import glob
import itertools
import os
import platform
import signal
import sys
from collections.abc import Callable, Generator
from contextlib import contextmanager

from sprintlab.cli.interruptions import tidy_termination
from sprintlab.core.errors import SprintlabError, printable
from sprintlab.core.interpreters import SAFE_PATH
from sprintlab.core.leaving import unfinished
from sprintlab.core.signals import handled_by, terminations
from sprintlab.core.streams import lasting_streams

REFUSED = 2
INTERRUPTED = 130
_LIBRARIES = ("libcuda.so.1", "libnvrtc.so.12", "libnvrtc.so.13", "libcask_profile_interface.so")
"""What PyTorch's cuSPARSELt looks for in the working folder, too: its search path ends with a colon."""


def exit_status(program: str, work: Callable[[], int]) -> int:
    """Do a command's work and return its exit status; no expected failure shows a traceback.

    Args:
        program: name that begins the sentence on stderr.
        work: parses and runs; returns the status where nothing fails.
    """
    _without_the_matplotlibrc_of_this_folder()
    with lasting_streams(), _no_modules_of_this_folder():
        status = _status(program, work)
        _wait_until_left(status)
        return status


def _wait_until_left(status: int) -> None:
    """Wait for what still closes; who asks for an end meanwhile gets it at once, all has been said.

    Left to Python, that would end in a traceback, and its libraries might not survive it.
    """
    for thread in unfinished():
        with handled_by(lambda number, frame: os._exit(status), (signal.SIGINT, *terminations())):
            thread.join()


@contextmanager
def _no_modules_of_this_folder() -> Generator[None]:
    """Python processes that a command or its libraries start do not look for modules where it was started.

    ``python -c`` and ``python -m`` look there first, and in a stranger's folder may lie a ``struct.py``.
    Python 3.10 cannot be told.
    """
    before = os.environ.get(SAFE_PATH)
    os.environ[SAFE_PATH] = "1"
    try:
        yield
    finally:
        os.environ.pop(SAFE_PATH)
        if before is not None:
            os.environ[SAFE_PATH] = before


def _without_the_matplotlibrc_of_this_folder() -> None:
    """matplotlib reads it before the account's own, once, when it is imported: a pipe, or a TeX preamble."""
    if not os.path.lexists("matplotlibrc"):
        return
    here = os.getcwd()
    os.chdir(os.path.dirname(__file__))
    try:
        import matplotlib as matplotlib
    finally:
        os.chdir(here)


def _check_libraries_of_this_folder() -> None:
    """Refuse a folder whose libraries every process that imports PyTorch would load and run.

    Raises:
        SprintlabError: names the library.
    """
    machine = platform.machine()
    searched = itertools.product(("", "tls"), ("", "haswell", machine), ("", machine))
    folders = [*(os.path.join(*parts) for parts in searched), *glob.glob("glibc-hwcaps/*")]
    for path in (os.path.join(folder, name) for folder in folders for name in _LIBRARIES):
        if os.path.lexists(path):
            raise SprintlabError(f"{path} in the working folder would be run by PyTorch: start elsewhere")


def _status(program: str, work: Callable[[], int]) -> int:
    try:
        _check_libraries_of_this_folder()
        with tidy_termination():
            status = work()
        sys.stdout.flush()
        return status
    except KeyboardInterrupt:
        print(f"{program}: interrupted", file=sys.stderr)
        return INTERRUPTED
    except BrokenPipeError:
        # The reader of a pipe is gone (``| head``): nothing is left to say, not even at interpreter exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except (SprintlabError, OSError) as error:
        print(f"{program}: {printable(' '.join(str(error).split()), longest=2000)}", file=sys.stderr)
        return REFUSED
