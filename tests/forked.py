"""Processes that begin as copies of one that has imported what they need: in hundredths of a second."""

from __future__ import annotations

import multiprocessing
import os
import subprocess
from collections.abc import Callable
from multiprocessing.connection import Connection
from typing import Any

_CONTEXT = multiprocessing.get_context("forkserver")
# The first process is alone in its imports: a copy of this one would have its threads' locks and no threads.
_CONTEXT.set_forkserver_preload(
    [
        "mcap.writer",
        "sprintlab.cli.main",
        "sprintlab.deployment.controller",
        "sprintlab.deployment.simulator",
        "tests.deployment.quick",
        "tests.forked",
    ]
)


class Forked:
    """A function in a process of its own, with what these tests use of ``subprocess.Popen``.

    Its output must fit into a pipe: it is read when the process has ended, or line by line.
    """

    def __init__(
        self,
        function: Callable[..., object],
        *arguments: object,
        cwd: str | os.PathLike[str] | None = None,
        prepare: Callable[[], object] | None = None,
    ) -> None:
        (out, to_out), (err, to_err) = _CONTEXT.Pipe(duplex=False), _CONTEXT.Pipe(duplex=False)
        given = (os.fspath(cwd or os.getcwd()), to_out, to_err, prepare, function, arguments)
        self._process = _CONTEXT.Process(target=_begin, args=given, daemon=True)  # no longer than its test's
        self._process.start()
        to_out.close()
        to_err.close()
        self.stdout, self.stderr = (os.fdopen(os.dup(end.fileno())) for end in (out, err))

    @property
    def returncode(self) -> int | None:
        """Exit status, minus the signal that ended it, or None while it runs."""
        return self._process.exitcode

    @property
    def pid(self) -> int:
        pid = self._process.pid
        assert pid is not None
        return pid

    def poll(self) -> int | None:
        return self.returncode

    def wait(self, timeout: float | None = None) -> None:
        self._process.join(timeout)
        if self.returncode is None:
            raise subprocess.TimeoutExpired("a forked process", timeout or 0.0)

    def communicate(self, timeout: float | None = None) -> tuple[str, str]:
        self.wait(timeout)
        return self.stdout.read(), self.stderr.read()

    def kill(self) -> None:
        self._process.kill()

    def __enter__(self) -> Forked:
        return self

    def __exit__(self, *_: Any) -> None:
        self.stdout.close()
        self.stderr.close()
        self.wait()


def _begin(
    folder: str,
    out: Connection,
    err: Connection,
    prepare: Callable[[], object] | None,
    function: Callable[..., object],
    arguments: tuple[object, ...],
) -> None:
    os.chdir(folder)
    for number, end in ((1, out), (2, err)):
        os.dup2(end.fileno(), number)
        end.close()
    if prepare is not None:
        prepare()
    function(*arguments)
