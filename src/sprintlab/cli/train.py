"""``sprintlab train``: a thin door to ``sprintlab.training``, which is an extra."""

from __future__ import annotations

import contextlib
import io
import itertools
import os
import shlex
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import tyro

from sprintlab.api.training import require_training
from sprintlab.core.errors import SprintlabError

DECIDED = {
    "--settings.method": "--method",
    "--settings.seed": "--seed",
    "--settings.simulation.environments": "--environments",
}
"""Settings that an option of the run decides, and that option."""


@dataclass(frozen=True, kw_only=True)
class Train:
    """Train a policy with one of the methods; ``sprintlab train --help`` lists every option.

    Attributes:
        method: name of the training method, e.g. sprint.
    """

    method: tyro.conf.Positional[str]

    def run(self) -> int:
        """Train with every option at its default."""
        return run_training([self.method])


def run_training(arguments: Sequence[str]) -> int:
    """Parse the options of a training run and run it.

    Args:
        arguments: what follows ``sprintlab train``; a first word without dash is the method.

    Raises:
        SprintlabError: the extra is missing, or an option is refused.
    """
    require_training()
    for word in (argument.partition("=")[0] for argument in arguments):
        if word in DECIDED:
            raise SprintlabError(f"{word} is decided by the run: use {DECIDED[word]}")
    from sprintlab.training.runs.options import TrainOptions, check_places

    options = _parse(TrainOptions, method_as_option(arguments))
    check_places(options)  # before PyTorch is imported, which takes many seconds
    from sprintlab.training.runs.run import train

    checkpoint = train(options)
    if os.environ.get("RANK", "0") == "0":  # of several processes, one speaks
        print(next_steps(checkpoint), file=sys.stderr)
    return 0


def next_steps(checkpoint: Path) -> str:
    """What to do with a training that has ended, as lines to copy."""
    policy = shlex.quote(str(checkpoint.with_name("policy.onnx")))
    return (
        f"next: sprintlab learning {shlex.quote(str(checkpoint.parent))}\n"
        f"      sprintlab export {shlex.quote(str(checkpoint))} {policy}\n"
        f"      sprintlab race {policy}"
    )


def method_as_option(arguments: Sequence[str]) -> list[str]:
    """``["sprint", ...]`` as ``["--method", "sprint", ...]``."""
    if arguments and not arguments[0].startswith("-"):
        return ["--method", *arguments]
    return list(arguments)


def short_help(text: str) -> str:
    """The options of a run out of its whole help; the settings, which follow them, are for ``--help-all``."""
    kept = itertools.takewhile(lambda line: "settings options" not in line, text.splitlines())
    return "\n".join([*kept, "Every setting of training, by group: sprintlab train --help-all"])


def _parse(options: Any, arguments: list[str]) -> Any:
    """Parse a dataclass; a refusal by its own checks is raised as it is, not as a usage error."""
    if "--help-all" in arguments:
        return tyro.cli(options, prog="sprintlab train", args=["--help"])
    if {"-h", "--help"} & set(arguments):
        shown = io.StringIO()
        with contextlib.redirect_stdout(shown), contextlib.suppress(SystemExit):
            tyro.cli(options, prog="sprintlab train", args=["--help"])
        print(short_help(shown.getvalue()))
        raise SystemExit(0)
    usage = io.StringIO()
    try:
        with contextlib.redirect_stderr(usage):
            return tyro.cli(options, prog="sprintlab train", args=arguments)
    except SystemExit as stop:
        refusal = _refusal(stop)
        if refusal is not None:
            raise refusal from None
        print(usage.getvalue(), end="", file=sys.stderr)
        raise


def _refusal(error: BaseException | None) -> SprintlabError | None:
    """The error of this package that stands behind a parser's exit, if there is one."""
    while error is not None:
        if isinstance(error, SprintlabError):
            return error
        error = error.__cause__ or error.__context__
    return None
