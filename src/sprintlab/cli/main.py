"""The ``sprintlab`` command: every command is a function of ``sprintlab.api``, its parameters the options.

Parameters before the ``*`` of a signature are typed without their names; the docstring is the help. Exit
status: 0 done, 1 done but the robot fell or was stopped (``run``, ``robot-sim``), 2 refused with a sentence
on stderr, 130 interrupted. A module of ``sprintlab.api`` is imported only for one of its commands, so that
``--help`` answers at once.
"""

from __future__ import annotations

import ast
import difflib
import inspect
import sys
import textwrap
from collections.abc import Callable, Sequence
from dataclasses import MISSING, field, make_dataclass
from importlib import import_module
from pathlib import Path
from types import UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

import tyro

from sprintlab import api
from sprintlab.api.drive import DriveOptions
from sprintlab.api.options import OPTIONS
from sprintlab.api.results import Drawn, Progress, Result, silent
from sprintlab.cli.output import REFUSED, exit_status, print_json, progress_bar, stdout_console
from sprintlab.core.errors import SprintlabError, printable
from sprintlab.core.extras import package_version
from sprintlab.core.files import check_figure_path
from sprintlab.core.joystick import DEFAULT_DEVICE

COMMANDS: dict[str, dict[str, Any]] = {
    "see it": {"race": "races.race", "play": "replays.play", "replay": "replays.replay"},
    "measure": {
        "evaluate": "evaluations.evaluate",
        "turning": "perturbations.turning",
        "lap": "perturbations.lap",
        "ground": "perturbations.ground",
        "robustness": "perturbations.robustness",
        "audit": "limits.audit_rollout",
        "limit": "limits.limit",
        "design": "design.design",
    },
    "motors and robots": {
        "motor": {
            "envelope": "motors.envelope",
            "from-datasheet": "motors.motor_from_datasheet",
            "identify": "motors.identify_motor",
            "library": "motors.actuators",
            "show": "motors.show_motor",
        },
        "robot": {"show": "robots.show_robot", "new": "robots.import_robot", "list": "robots.list_robots"},
    },
    "train": {
        "train": "training.train",
        "sweep": "training.sweep",
        "export": "training.export",
        "doctor": "doctor.doctor",
    },
    "deploy": {"run": "robot_bus.run", "robot-sim": "robot_bus.robot_sim", "report": "reports.report"},
}
"""The commands by what one wants: the functions' places in ``sprintlab.api``, or subcommands by name."""
ALL = {name: command for commands in COMMANDS.values() for name, command in commands.items()}
DEFAULTS = {"races.race": {"report": True, "video": True}}
"""Defaults of the command line that are not the function's."""
SUMMARIES = {
    "": "How fast can a legged robot run before its motors, not its controller, stop it?",
    "motor": "Motors: from a data sheet or a bench to parameters, envelope and picture.",
    "robot": "Robots and where their numbers come from.",
}
REPEATED = ("column", "set", "vary")
"""Options of several values that are typed once for each."""
_CONFIG = (tyro.conf.OmitArgPrefixes, tyro.conf.OmitSubcommandPrefixes, tyro.conf.FlagCreatePairsOff)
_NAMES = {
    "Any": Any, "Drawn": Drawn, "DriveOptions": DriveOptions, "Literal": Literal, "Path": Path,
    "PolicyChoice": str, "Progress": Progress, "Race": Drawn, "Result": Result, "RobotChoice": str | None,
    "Sequence": Sequence, "Training": Result, "DEFAULT_DEVICE": DEFAULT_DEVICE, "silent": silent,
}  # fmt: skip
"""Names in the signatures of the commands."""
_FIGURE = Annotated[Path | None, tyro.conf.arg(help="picture to draw (.png, .pdf or .svg).")]
_JSON = Annotated[bool, tyro.conf.arg(help="print JSON only.")]


_REGISTRY = tyro.constructors.ConstructorRegistry()


@_REGISTRY.primitive_rule
def _optional(info: tyro.constructors.PrimitiveTypeInfo) -> Any:
    """How ``kind | None`` is read: only ``kind`` can be typed, and help and refusals name nothing else."""
    kind = next((each for each in (str, int, float, Path) if info.type == each | None), None)
    if kind is None:
        return None
    return tyro.constructors.PrimitiveConstructorSpec[Any](
        nargs=1,
        metavar=kind.__name__.upper(),
        instance_from_str=lambda words: kind(words[0]),
        is_instance=lambda value: value is None or isinstance(value, kind),
        str_from_instance=lambda value: [str(value)],
    )


def declared(command: str) -> Callable[..., Any]:
    """A command's function without its body, from the source: nothing that it works with is imported."""
    module, _, name = command.partition(".")
    tree = ast.parse(Path(api.__path__[0], f"{module}.py").read_text(encoding="utf-8"))
    found = next(node for node in tree.body if isinstance(node, ast.FunctionDef) and node.name == name)
    found.decorator_list, found.body = [], found.body[:1]  # the docstring
    names = dict(_NAMES)
    exec(compile(ast.Module([found], []), module, "exec", dont_inherit=True), names)  # hints as objects
    return names[name]


def typed(command: str) -> Any:
    """A dataclass of the parameters of a command's function, from which the parser is made."""
    function, options = declared(command), list[tuple[str, Any, Any]]()
    documented, signature = inspect.getdoc(function) or "", inspect.signature(function)
    for name, parameter in signature.parameters.items():
        if name == "progress":
            continue
        kind, required = _kind(parameter.annotation), parameter.default is parameter.empty
        shared = None if f"\n    {name}: " in documented else OPTIONS.get(name)
        if parameter.kind is not parameter.KEYWORD_ONLY:
            shown = f"{name.upper()} ..." if get_origin(kind) is tuple else name.upper()
            shown = shown if required else f"[{shown}]"
            kind = tyro.conf.Positional[Annotated[kind, tyro.conf.arg(help=shared, metavar=shown)]]
        elif name in REPEATED:
            kind = tyro.conf.UseAppendAction[Annotated[kind, tyro.conf.arg(help=shared)]]
        else:
            kind = Annotated[kind, tyro.conf.arg(help=shared)]
        value = MISSING if required else DEFAULTS.get(command, {}).get(name, parameter.default)
        options.append((name, kind, field(default=value)))
    if signature.return_annotation is Drawn:
        options.append(("figure", _FIGURE, field(default=None)))
    options.append(("json", _JSON, field(default=False)))
    told = {"__doc__": documented.replace("\nExample:", "\n\nExample:")}  # in a paragraph of its own
    return make_dataclass("Typed", options, namespace=told, kw_only=True, frozen=True)


def _kind(kind: Any) -> Any:
    """What is typed for a parameter: the first type of those that it takes, for a sequence any number."""
    if get_origin(kind) is Sequence:
        return tuple[_kind(get_args(kind)[0]), ...]
    if get_origin(kind) not in (Union, UnionType):
        return kind
    first, *others = (each for each in get_args(kind) if each in (str, int, float, Path, type(None)))
    return first | None if type(None) in others else first


def run_command(function: Callable[..., Result], given: dict[str, Any]) -> int:
    """Call a function with what was typed; print and draw the result, and return its status.

    A result is printed also where its files or its picture cannot be written; then it raises all the same.
    """
    given = dict(given)
    json, drawn = given.pop("json"), {"figure": given.pop("figure")} if "figure" in given else {}
    figure = drawn.get("figure")
    check_figure_path(figure)
    reports = "progress" in inspect.signature(function).parameters

    def show(found: Result) -> None:
        if not json:
            stdout_console().print(found, soft_wrap=True)
            return
        numbers = found.to_dict()
        told = {name: path and str(path) for name, path in drawn.items()}
        print_json({**numbers, **told} if isinstance(numbers, dict) else numbers)

    try:
        with progress_bar(quiet=json or not reports) as progress:
            if reports:
                progress("loading", None)
                given["progress"] = progress
            found = function(**given)
    except BaseException as error:
        if isinstance(kept := getattr(error, "found", None), Result):
            show(kept)
        raise
    try:
        show(found)
        found.run()
    except KeyboardInterrupt:
        if found.serve is None:
            raise
    if figure is not None and isinstance(found, Drawn):
        from sprintlab.core.theme import save_figure

        save_figure(figure, found.plot())
        if not json:
            stdout_console().print(f"figure: {figure}", soft_wrap=True)
    return found.status


def summary(name: str, command: Any) -> str:
    """The first sentence of what a command does."""
    if isinstance(command, dict):
        return SUMMARIES[name]
    return (inspect.getdoc(declared(command)) or "").partition("\n")[0]


def grouped_help(title: str = "", commands: dict[str, Any] | None = None) -> str:
    """What ``sprintlab --help`` prints: the commands by what one wants; or the subcommands of one of them."""
    called = f"sprintlab {title}".rstrip()
    lines = [f"usage: {called} COMMAND [OPTIONS]", "", SUMMARIES[title]]
    for heading, group in COMMANDS.items() if commands is None else [("commands", commands)]:
        lines += ["", heading]
        for name, command in group.items():
            told = f"  {name:<14} " if commands else f"  {name:<11} "
            lines += textwrap.wrap(told + summary(name, command), 100, subsequent_indent=" " * len(told))
    more = "" if title else "; sprintlab --version the version"
    return "\n".join([*lines, "", f"{called} COMMAND --help lists a command's options{more}."])


def parse(arguments: Sequence[str]) -> tuple[Callable[..., Result], dict[str, Any]]:
    """The function that a command line names, and its arguments; nothing runs yet.

    Raises:
        SprintlabError: there is no such command; ``SystemExit``: help was printed, or what an option lacks.
    """
    words, named, level = list(arguments), ["sprintlab"], ALL
    while isinstance(level, dict):
        place = " ".join(named[1:])
        if not words or words[0] in ("-h", "--help"):
            print(grouped_help(place, level if place else None))
            raise SystemExit(0 if words else REFUSED)
        if words[0] not in level:
            near = difflib.get_close_matches(words[0], list(level), n=1, cutoff=0.5)
            hint = f"did you mean {near[0]}?" if near else f"{' '.join(named)} --help lists all"
            raise SprintlabError(f"there is no command {printable(words[0])}: {hint}")
        named.append(words.pop(0))
        level = level[named[-1]]
    found = tyro.cli(typed(level), prog=" ".join(named), args=words, config=_CONFIG, registry=_REGISTRY)
    module, _, name = level.partition(".")
    return getattr(import_module(f"sprintlab.api.{module}"), name), vars(found)


def completion(arguments: Sequence[str]) -> None:
    """Print a shell's completion script, as ``--tyro-print-completion SHELL`` asks, and end."""

    def union(commands: dict[str, Any]) -> Any:
        kinds = (
            Annotated[
                make_dataclass("Group", [("command", union(each))])
                if isinstance(each, dict)
                else typed(each),
                tyro.conf.subcommand(name=name),
            ]
            for name, each in commands.items()
        )
        return Union[tuple(kinds)]  # noqa: UP007 (a tuple cannot be joined with |)

    tyro.cli(union(ALL), prog="sprintlab", args=list(arguments), config=_CONFIG, registry=_REGISTRY)


def run_words(arguments: Sequence[str]) -> int:
    """Parse and run one command; returns its exit status. Raises ``SprintlabError``."""
    if list(arguments) == ["--version"]:
        print(f"sprintlab {package_version('sprintlab')}")
        return 0
    if arguments and arguments[0].startswith("--tyro-"):
        completion(arguments)
    return run_command(*parse(arguments))


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return the exit status; no expected failure shows a traceback."""
    return exit_status("sprintlab", lambda: run_words(sys.argv[1:] if arguments is None else arguments))


if __name__ == "__main__":
    sys.exit(main())
