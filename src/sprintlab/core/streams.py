"""Standard streams of a command: closed, full or read by nobody, they are no reason to end its work."""

from __future__ import annotations

import io
import os
import sys
from collections.abc import Generator
from contextlib import contextmanager, suppress
from typing import Any


@contextmanager
def lasting_streams() -> Generator[None]:
    """What nobody reads ends no training and no run of a robot.

    A standard stream that is closed is the null device: otherwise the next file that is opened, such as a
    log, would take its number. What stderr does not take (its reader is gone, its disk is full) is dropped.
    What the encoding of stdout cannot say, such as names of a stranger's files, appears as its code.
    """
    for number, name, mode in ((0, "stdin", "r"), (1, "stdout", "w"), (2, "stderr", "w")):
        try:
            os.fstat(number)
        except OSError:
            os.set_inheritable(os.open(os.devnull, os.O_RDWR), True)  # the lowest free number is this one
        if getattr(sys, name) is None:
            stream = open(number, mode, encoding="utf-8", closefd=False)  # noqa: SIM115
            setattr(sys, name, stream)
    before = sys.stderr
    if before is sys.__stderr__:  # a test's or a notebook's is its own affair
        stream = io.BufferedWriter(_Lasting(before.fileno(), "w", closefd=False))
        sys.stderr = io.TextIOWrapper(stream, before.encoding, "backslashreplace", line_buffering=True)
    try:
        with _any_text(sys.stdout):
            yield
    finally:
        sys.stderr.flush()
        sys.stderr = before


@contextmanager
def _any_text(stream: Any) -> Generator[None]:
    """A stream of the system takes every text within the block; a test's or a notebook's is left alone."""
    if stream is not sys.__stdout__ or not isinstance(stream, io.TextIOWrapper):
        yield
        return
    before = stream.errors
    _reconfigure(stream, "backslashreplace")
    try:
        yield
    finally:
        _reconfigure(stream, before)


def _reconfigure(stream: Any, errors: str | None) -> None:
    """Say what becomes of characters that a stream's encoding lacks, if it can still be told."""
    # It flushes first, whose reader may be gone, and seeks what was a file before a process made it a pipe.
    with suppress(OSError, ValueError):
        stream.reconfigure(errors=errors)


class _Lasting(io.FileIO):
    """Takes whatever is written."""

    def write(self, data: Any) -> int:
        try:
            written = super().write(data)
        except OSError:
            written = None
        return len(data) if written is None else written
