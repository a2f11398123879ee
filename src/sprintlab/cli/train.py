"""``sprintlab train``: a thin door to ``sprintlab.training``, which is an extra."""

from __future__ import annotations

import contextlib
import io
import itertools
import os
import re
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import tyro

from sprintlab.api.training import require_training
from sprintlab.cli.unknown import refuse_unknown_option
from sprintlab.core.errors import SprintlabError

if TYPE_CHECKING:
    from sprintlab.training.runs.options import TrainOptions

DECIDED = {
    "--settings.method": "--method",
    "--settings.seed": "--seed",
    "--settings.simulation.environments": "--environments",
}
"""Settings that an option of the run decides, and that option."""

HELP = {"-h", "--help", "--help-all"}
"""Options that print help, for which the training extra is not needed."""

DESCRIPTION = """Train a policy. The first word may be the method: sprintlab train sprint.
--config RUN.TOML takes every option and setting from a file, such as the run.toml that each run leaves in its
folder; what is typed beside it wins."""


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
        SprintlabError: the extra is missing, or an option or the configuration file is refused.
    """
    if not HELP & set(arguments):
        require_training()
    from sprintlab.training.runs.options import check_places

    options = parse_training(arguments)
    check_places(options)  # before PyTorch is imported, which takes many seconds
    from sprintlab.training.runs.run import train

    checkpoint = train(options)
    if os.environ.get("RANK", "0") == "0":  # of several processes, one speaks
        _tell(checkpoint.parent, options.robot or options.settings.robot)
    return 0


def parse_training(arguments: Sequence[str]) -> TrainOptions:
    """The options of a training run: what is typed, else what the configuration file says, else the defaults.

    Raises:
        SprintlabError: an option or the configuration file is refused.
        SystemExit: help was printed, or an option is unknown.
    """
    from sprintlab.training.runs.options import TrainOptions
    from sprintlab.training.runs.run_file import read_run_file

    words, config = without_config(method_as_option(arguments))
    words = [internal_word(word) for word in words]
    for word in (word.partition("=")[0] for word in words):
        if word in DECIDED:
            raise SprintlabError(f"{public_text(word)} is decided by the run: use {DECIDED[word]}")
    options = _parse(TrainOptions() if config is None else read_run_file(config), words)
    named = ((re.match(r"(?:--)?settings\.([\w-]+)", word), word) for word in words)
    typed = {found[1].replace("-", "_"): public_text(word) for found, word in named if found}
    options.check_kept(typed, "{option} keeps yours")
    return options


def without_config(words: Sequence[str]) -> tuple[list[str], Path | None]:
    """The words without ``--config FILE`` or ``--config=FILE``, and the file.

    Raises:
        SprintlabError: the file is not named, or named twice.
    """
    rest, files, each = list[str](), list[str](), iter(words)
    for word in each:
        name, equals, value = word.partition("=")
        if name != "--config":
            rest.append(word)
            continue
        files.append(value if equals else next(each, ""))
    if len(files) > 1 or not all(files):
        raise SprintlabError("--config takes one file, e.g. --config runs/train/run.toml")
    return rest, Path(files[0]) if files else None


def internal_word(word: str) -> str:
    """``--ppo.steps`` as the parser has it, ``--settings.ppo.steps``; other words as they are."""
    from sprintlab.training.runs.run_file import SETTINGS

    dashes = "--" * word.startswith("--")
    name = word.removeprefix(dashes).replace("-", "_")
    first = re.split(r"[.=:]", name.removeprefix("no_"))[0]
    is_setting = first in SETTINGS and (bool(dashes) or ":" in word)
    return f"{dashes}settings.{word.removeprefix(dashes)}" if is_setting else word


def public_text(text: str) -> str:
    """Help and refusals of the parser with the names that people type."""
    for inner, shown in (("settings.", ""), ("SETTINGS.", ""), ("``", "`"), ("in sprintlab --help", "")):
        text = text.replace(inner, shown)
    return "\n".join(line.rstrip() for line in text.split("\n"))


def _tell(folder: Path, robot: str) -> None:
    """What the training reached, and the next command."""
    from rich.console import Console

    from sprintlab.api.reached import what_was_reached

    console = Console(stderr=True, highlight=False)
    console.print(
        f"policy: {folder / 'policy.onnx'}; three trials in the plant tell what it reached", soft_wrap=True
    )
    for part in what_was_reached(folder, robot):
        console.print(part, soft_wrap=isinstance(part, str), markup=not isinstance(part, str))


def method_as_option(arguments: Sequence[str]) -> list[str]:
    """``["sprint", ...]`` as ``["--method", "sprint", ...]``."""
    if arguments and not arguments[0].startswith("-"):
        return ["--method", *arguments]
    return list(arguments)


def short_help(text: str) -> str:
    """The options of a run out of its whole help; the settings, which follow them, are for ``--help-all``."""
    kept = itertools.takewhile(lambda line: "settings options" not in line, text.splitlines())
    return "\n".join([*kept, "Every setting of training, by group: sprintlab train --help-all"])


def without_decided(text: str) -> str:
    """The help without the settings that an option of the run decides."""
    kept, hidden = list[str](), False
    for line in text.splitlines():
        word = line.split()[0] if line.split() else ""
        if word.startswith("--") or not word:
            hidden = word in {*DECIDED, "--settings.robot"}
        if not hidden:
            kept.append(line)
    return "\n".join(kept)


def _parse(default: TrainOptions, words: list[str]) -> TrainOptions:
    """Parse; a refusal by the options' own checks is raised as it is, not as a usage error."""
    asked = HELP & set(words)
    if asked:
        text = _help(default)
        print(text if "--help-all" in asked else short_help(text))
        raise SystemExit(0)
    said = io.StringIO()
    try:
        with contextlib.redirect_stderr(said):
            return _cli(default, words)
    except SystemExit as stop:
        if refusal := _refusal(stop):
            raise refusal from None
        if stop.code:
            refuse_unknown_option("train", [public_text(word) for word in words], _help(default))
        print(public_text(without_decided(said.getvalue())), end="", file=sys.stderr)
        raise


def _help(default: TrainOptions) -> str:
    said = io.StringIO()
    with contextlib.redirect_stdout(said), contextlib.suppress(SystemExit):
        _cli(default, ["--help"])
    return public_text(without_decided(said.getvalue()))


def _cli(default: TrainOptions, words: list[str]) -> TrainOptions:
    return tyro.cli(
        type(default), prog="sprintlab train", description=DESCRIPTION, default=default, args=words
    )


def _refusal(error: BaseException | None) -> SprintlabError | None:
    """The error of this package that stands behind a parser's exit, if there is one."""
    while error is not None:
        if isinstance(error, SprintlabError):
            return error
        error = error.__cause__ or error.__context__
    return None
