"""``python -m studies.paper``: the paper's six methods, planned, trained, evaluated and judged."""

from __future__ import annotations

import sys
from typing import Annotated, Any

import tyro

from sprintlab.cli.output import exit_status
from studies.paper.evaluate import Evaluate
from studies.paper.page import Page
from studies.paper.plan import Plan, Train
from studies.paper.verdicts import Verdicts

Command = (
    Annotated[Plan, tyro.conf.subcommand(name="plan")]
    | Annotated[Train, tyro.conf.subcommand(name="train")]
    | Annotated[Evaluate, tyro.conf.subcommand(name="evaluate")]
    | Annotated[Verdicts, tyro.conf.subcommand(name="verdicts")]
    | Annotated[Page, tyro.conf.subcommand(name="page")]
)


def main(arguments: list[str] | None = None) -> int:
    """Run one command; a refusal is one sentence on stderr and status 2."""
    command: Any = tyro.cli(
        Command,  # pyright: ignore[reportArgumentType]
        prog="python -m studies.paper",
        description=__doc__,
        args=arguments,
        config=(tyro.conf.OmitArgPrefixes, tyro.conf.OmitSubcommandPrefixes),
    )
    return exit_status("studies.paper", command.run)


if __name__ == "__main__":
    sys.exit(main())
