"""``python -m studies.paper``: the paper's comparison of six methods, evaluated and drawn."""

from __future__ import annotations

import sys
from typing import Annotated, Any

import tyro

from sprintlab.cli.status import exit_status
from sprintlab.core.errors import printable_stderr
from studies.paper.compare import Compare
from studies.paper.network import Network
from studies.paper.page import Page
from studies.paper.plan import Plan
from studies.paper.stride import Strides
from studies.paper.variants import Variants

Command = (
    Annotated[Compare, tyro.conf.subcommand(name="table")]
    | Annotated[Network, tyro.conf.subcommand(name="network")]
    | Annotated[Strides, tyro.conf.subcommand(name="stride")]
    | Annotated[Plan, tyro.conf.subcommand(name="plan")]
    | Annotated[Variants, tyro.conf.subcommand(name="variants")]
    | Annotated[Page, tyro.conf.subcommand(name="page")]
)


def main(arguments: list[str] | None = None) -> int:
    """Run one command; a refusal is one sentence on stderr and status 2."""
    with printable_stderr():
        command: Any = tyro.cli(
            Command,  # pyright: ignore[reportArgumentType]
            prog="python -m studies.paper",
            description=__doc__,
            args=None if arguments is None else list(arguments),
            config=(tyro.conf.OmitArgPrefixes, tyro.conf.OmitSubcommandPrefixes),
        )
    return exit_status("studies.paper", command.run)


if __name__ == "__main__":
    sys.exit(main())
