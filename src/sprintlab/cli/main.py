"""Entry point: parse, run one command, turn every expected failure into one sentence and a status.

Exit status: 0 done, 1 done but the robot fell or was stopped (``run``, ``robot-sim``), 2 refused with a
sentence on stderr, 130 interrupted. Heavy imports happen inside the commands, so that ``--help`` answers at
once.
"""

from __future__ import annotations

import contextlib
import functools
import io
import sys
import textwrap
from collections.abc import Callable, Sequence
from typing import Any, get_args, get_type_hints

import tyro

from sprintlab.api.doctor import doctor
from sprintlab.api.evaluations import evaluate
from sprintlab.api.grounds import ground
from sprintlab.api.learning import learning
from sprintlab.api.limits import limit
from sprintlab.api.races import Race, race
from sprintlab.api.replay import replay
from sprintlab.api.robustness import robustness
from sprintlab.api.rollouts import audit_rollout
from sprintlab.api.run_reports import report_run
from sprintlab.api.steering import lap, turning
from sprintlab.cli.build import FIGURE, choice, command
from sprintlab.cli.export import Export
from sprintlab.cli.motor import Motor
from sprintlab.cli.play import Play
from sprintlab.cli.robot import Robot
from sprintlab.cli.robot_sim import RobotSim
from sprintlab.cli.run import Run
from sprintlab.cli.status import REFUSED, exit_status
from sprintlab.cli.sweep import Sweep
from sprintlab.cli.train import Train
from sprintlab.cli.unknown import did_you_mean, refuse_unknown_option
from sprintlab.core.errors import SprintlabError, printable
from sprintlab.core.extras import package_version
from sprintlab.core.files import default_folder


def _reported(race: Callable[..., Race]) -> Callable[..., Race]:
    """A race whose report goes into a folder of its own where none is named."""

    @functools.wraps(race)
    def run(**given: Any) -> Race:
        return race(**{**given, "folder": given["folder"] or default_folder()})

    return run


COMMANDS = {
    "see it": {
        "race": command(_reported(race), names={"folder": "output"}, defaults={"video": True}),
        "play": Play,
        "replay": command(replay),
    },
    "measure": {
        "evaluate": command(evaluate, required="policy"),
        "turning": command(turning, required="policy", figure="also draw the map here (.png, .pdf or .svg)."),
        "lap": command(
            lap,
            required="policy",
            figure="also draw the path here (.png, .pdf or .svg).",
            status=lambda lap: 1 if lap.found.trial.fall_reason else 0,
        ),
        "ground": command(ground, required="policy"),
        "robustness": command(robustness, names={"folder": "output"}, figure=FIGURE),
        "audit": command(audit_rollout, figure="torque-speed picture of every joint (.png, .pdf or .svg)."),
        "limit": command(limit, figure=FIGURE),
    },
    "motors and robots": {"motor": Motor, "robot": Robot},
    "train": {
        "train": Train,
        "sweep": Sweep,
        "learning": command(learning),
        "export": Export,
        "doctor": command(doctor, positional=0, status=lambda examined: 0 if examined.ok else 1),
    },
    "deploy": {
        "run": Run,
        "robot-sim": RobotSim,
        "report": command(report_run, names={"folder": "output", "simulate": "simulation"}),
    },
}
"""The commands by what one wants."""

Command = choice({name: kind for kinds in COMMANDS.values() for name, kind in kinds.items()})


def named_commands(union: Any) -> dict[str, Any]:
    """The classes of a union of commands by the names that people type."""
    return {how.name: kind for kind, how, *_ in map(get_args, get_args(union))}


def commands() -> dict[str, str]:
    """Every command and the first sentence of what it does."""
    return {
        name: (kind.__doc__ or "").strip().partition("\n")[0].replace("``", "")
        for name, kind in named_commands(Command).items()
    }


def grouped_help() -> str:
    """What ``sprintlab --help`` prints: the commands by what one wants."""
    known = commands()
    lines = [
        "usage: sprintlab COMMAND [OPTIONS]",
        "",
        "How fast can a legged robot run before its motors, not its controller, stop it?",
    ]
    for title, names in COMMANDS.items():
        lines += ["", title]
        for name in names:
            lines += textwrap.wrap(
                known[name], 100, initial_indent=f"  {name:<11} ", subsequent_indent=" " * 14
            )
    return "\n".join(
        [*lines, "", "sprintlab COMMAND --help lists a command's options; sprintlab --version the version."]
    )


def refuse_unknown(words: Sequence[str]) -> None:
    """Name the nearest command where somebody mistyped one, also one of ``motor`` or ``robot``.

    Raises:
        SprintlabError: there is no such command.
    """
    level, typed = Command, "sprintlab"
    for word in words:
        known = named_commands(level)
        if word.startswith("-"):
            return
        if word not in known:
            hint = did_you_mean(word, known, f"{typed} --help lists all commands")
            raise SprintlabError(f"there is no command {printable(word)}: {hint}")
        level, typed = get_type_hints(known[word], include_extras=True).get("command"), f"{typed} {word}"
        if level is None:
            return


def parse(arguments: Sequence[str]) -> Any:
    """Turn a command line into the command that it names; nothing runs yet.

    Raises:
        SprintlabError: an option is not one of the command.
        SystemExit: help was printed, or the command line makes no sense.
    """
    said = io.StringIO()
    try:
        with contextlib.redirect_stderr(said):
            return _parse(arguments)
    except SystemExit as stop:
        if stop.code == REFUSED:
            named = command_words(arguments)
            refuse_unknown_option(" ".join(named), arguments[len(named) :], _help_of(named))
        print(said.getvalue(), end="", file=sys.stderr)
        raise


def command_words(words: Sequence[str]) -> list[str]:
    """The first words, as far as they name a command: ``["motor", "envelope"]``."""
    level, named = Command, list[str]()
    for word in words:
        known = {} if level is None else named_commands(level)
        if word not in known:
            break
        named.append(word)
        level = get_type_hints(known[word], include_extras=True).get("command")
    return named


def _help_of(named: Sequence[str]) -> str:
    said = io.StringIO()
    with contextlib.redirect_stdout(said), contextlib.suppress(SystemExit):
        _parse([*named, "--help"])
    return said.getvalue()


def _parse(arguments: Sequence[str]) -> Any:
    return tyro.cli(
        Command,
        prog="sprintlab",
        description="How fast can a legged robot run before its motors stop it? (See also --version.)",
        args=list(arguments),
        config=(
            tyro.conf.OmitArgPrefixes,
            tyro.conf.OmitSubcommandPrefixes,
            tyro.conf.FlagCreatePairsOff,
        ),
    )


def run(arguments: Sequence[str]) -> int:
    """Parse and run one command.

    Returns:
        The command's exit status.

    Raises:
        SprintlabError: the command was refused or failed.
        SystemExit: help was printed, or the command line makes no sense.
    """
    if not arguments or list(arguments[:1]) in (["--help"], ["-h"]):
        print(grouped_help())
        return 0 if arguments else REFUSED
    refuse_unknown(arguments)
    if list(arguments) == ["--version"]:
        print(f"sprintlab {package_version('sprintlab')}")
        return 0
    return parse(arguments).run()


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return the exit status; no expected failure shows a traceback."""
    return exit_status("sprintlab", lambda: run(sys.argv[1:] if arguments is None else arguments))


if __name__ == "__main__":
    sys.exit(main())
