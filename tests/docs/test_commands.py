"""Every command in README and docs: run where it is quick, else parsed as the command line parses it.

A shell line is one of: ``sprintlab``, ``make``, ``pip``, ``python FILE``, ``python -m MODULE``, or a plain
shell word of ``SHELL``. Anything else fails, so that a new kind of line is looked at.
"""

import ast
import importlib
import importlib.util
import io
import itertools
import re
import shlex
import shutil
import subprocess
import textwrap
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest

from sprintlab.cli.main import main, parse
from sprintlab.control import shipped_policy
from sprintlab.motors import PmsmParameters, save_motor
from sprintlab.robots import load_robot
from sprintlab.robots.importing import import_robot, make_choices, read_choices

try:
    import tomllib
except ModuleNotFoundError:  # Python 3.10
    import tomli as tomllib

ROOT = Path(__file__).resolve().parents[2]
PAGES = sorted([ROOT / "README.md", ROOT / "CONTRIBUTING.md", *(ROOT / "docs").glob("*.md")])
GO1 = ROOT / "examples" / "go1"
FENCE = re.compile(r"^ *```(\w*)[^\n]*\n(.*?)^ *```", re.MULTILINE | re.DOTALL)  # in tabs they are indented
SHELLS = {"sh", "bash", "shell", "console"}
SHELL = {"cd", "git", "export", "source", "mkdir", "cp", "ls", "cat", "tar", "scp", "ssh", "."}
# Run as they stand, in a folder that holds the files of ``workplace``; everything else is only parsed.
QUICK = {("robot", "show"), ("robot", "list"), ("motor", "show"), ("motor", "envelope"), ("replay",)}
LEARNING = ("sprintlab.training", "sprintlab.integrations")


def shell_lines():
    """``(page, command words)`` of every command line in the pages."""
    for page in PAGES:
        for language, body in FENCE.findall(page.read_text(encoding="utf-8")):
            if language in SHELLS:
                for line in re.sub(r"\\\n\s*", " ", textwrap.dedent(body)).splitlines():
                    yield from ((page, words) for words in commands_in(line))


def commands_in(line):
    """The words of each command of a line; comments, assignments and redirections left out."""
    lexer = shlex.shlex(line.removeprefix("$ "), posix=True, punctuation_chars="|&;<>")
    lexer.whitespace_split, lexer.commenters = True, "#"
    command, skip = [], False
    for word in [*lexer, ";"]:
        if word in ("<", ">", ">>"):
            skip = True
        elif set(word) <= set("|&;"):
            if command:
                yield tuple(command)
            command = []
        elif skip:
            skip = False
        elif command or not re.fullmatch(r"[A-Z_]+=.*", word):
            command.append(word)


LINES = list(dict.fromkeys(shell_lines()))


def identity(value):
    return " ".join(value) if isinstance(value, tuple) else value.name


@pytest.fixture(scope="module")
def workplace(tmp_path_factory):
    """A folder with what the pages take for granted: a motor, a policy, the run that they name."""
    folder = tmp_path_factory.mktemp("docs")
    motors = load_robot("bp2").motors
    hip = {item.name: float(np.ravel(getattr(motors, item.name))[1]) for item in fields(motors)}
    save_motor(PmsmParameters(**hip), folder / "my-motor.toml")
    shutil.copy(shipped_policy(), folder / "my-policy.onnx")
    count = 100
    standing = np.zeros((count, 23))
    standing[:, 2], standing[:, 3] = 0.5, 1.0
    joints = {name: np.zeros((count, 12)) for name in ("joint_velocity", "motor_torque", "joint_torque")}
    limits = {"torque_lower": np.full((count, 12), -1.0), "torque_upper": np.full((count, 12), 1.0)}
    plane = {"velocity": np.zeros((count, 2)), "command": np.zeros((count, 3))}
    arrays = {"time": np.arange(count) / 500.0, "qpos": standing, **joints, **limits, **plane}
    (folder / "runs" / "sprint-0").mkdir(parents=True)
    (folder / "runs" / "sprint-0" / "run.toml").write_text('method = "acs"\n', encoding="utf-8")
    (folder / "examples").symlink_to(GO1.parent)
    import_robot(GO1 / "go1.xml", go1_choices(), folder / "robots")
    for name in named_runs():
        (folder / name).mkdir(parents=True)
        for file in ("trajectory.npz", "profile.npz"):
            np.savez(folder / name / file, **arrays)
    np.savez(folder / "lap.npz", **arrays)
    return folder


def go1_choices():
    """The tutorial's choices, as ``sprintlab robot new`` reads them."""
    return make_choices({**read_choices(GO1 / "choices.toml"), "name": "mydog"}, "choices.toml")


def named_runs():
    """Folders of races that the pages name."""
    return {match for _, words in LINES for match in re.findall(r"runs/race-[\d-]+", " ".join(words))}


def test_pages_hold_commands():
    assert len(LINES) > 15
    assert {words[0] for _, words in LINES} >= {"sprintlab", "make", "pip"}


@pytest.mark.parametrize(("page", "words"), LINES, ids=identity)
def test_command_of_the_pages_works(page, words, workplace, monkeypatch):
    monkeypatch.chdir(workplace)
    program, *arguments = words
    if program == "sprintlab":
        check_sprintlab(arguments)
    elif program in ("pip", "uv"):
        check_install(arguments)
    elif program == "make":
        check_make(arguments)
    elif program.startswith("python"):
        check_python(arguments)
    else:
        assert program in SHELL, f"{page.name}: no test knows what to do with: {' '.join(words)}"


def mentioned():
    """Commands with options in running text: ``(command words, options)``."""
    for page in (*PAGES, ROOT / "src/sprintlab/robots/README.md"):
        for line in re.findall(r"`sprintlab ([a-z][^`]*)`", page.read_text(encoding="utf-8")):
            words = line.split()
            command = words[: 2 if words[0] in ("motor", "robot") else 1]
            yield tuple(command), tuple(word for word in words if word.startswith("--"))


@pytest.mark.parametrize(("command", "options"), sorted(set(mentioned())))
def test_commands_that_the_text_mentions_have_those_options(command, options):
    with redirect_stdout(io.StringIO()) as output, pytest.raises(SystemExit):
        main([*command, "--help"])
    assert all(re.search(rf"{option}\b", output.getvalue()) for option in options), options


def check_sprintlab(arguments):
    if any(arguments[: len(quick)] == list(quick) for quick in QUICK):
        with redirect_stdout(io.StringIO()) as output:
            assert main(arguments) == 0
        assert output.getvalue().strip()
    elif not arguments[0].startswith("--"):
        parsed = []
        assert parses(lambda: parsed.append(parse(arguments)[1]))
        if arguments[:1] == ["train"] and parsed:
            check_training(parsed[0])


def check_training(given):
    """The settings that are changed have these names and may hold these values."""
    if importlib.util.find_spec("torch") is None:
        pytest.skip("needs the extra train")
    from sprintlab.training.methods import method
    from sprintlab.training.settings_text import with_changes

    base = method(given["method"] or "acs", robot=given["robot"] or "bp2", preset=given["preset"])
    with_changes(base, given["set"])


def parses(action):
    """Whether a parser takes its arguments; printing help counts."""
    try:
        with redirect_stdout(io.StringIO()), redirect_stderr(io.StringIO()):
            action()
    except SystemExit as stop:
        return stop.code in (0, None)
    return True


def check_install(arguments):
    """The extras exist."""
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"][
        "optional-dependencies"
    ]
    for wanted in re.findall(r"\[([\w,-]+)\]", " ".join(arguments)):
        assert set(wanted.split(",")) <= set(extras)


def check_make(arguments):
    """The Makefile knows the targets."""
    command = ["make", "--dry-run", "--always-make", *arguments]
    assert subprocess.run(command, cwd=ROOT, capture_output=True, check=False).returncode == 0


def check_python(arguments):
    """The script or module is there and names each option."""
    if arguments[:1] == ["-m"]:
        module = arguments[1]
        if not module.startswith("sprintlab"):
            return
        spec = importlib.util.find_spec(module)
        assert spec is not None and spec.origin is not None
        source = Path(spec.origin)
    else:
        source = next(path for path in (ROOT / arguments[0], Path(arguments[0])) if path.is_file())
    text = source.read_text(encoding="utf-8")
    for option in (word for word in arguments if word.startswith("--")):
        name = option.split("=")[0].removeprefix("--")
        assert name in text or name.replace("-", "_") in text, f"{source.name} does not know --{name}"


def inline_commands():
    """``sprintlab ...`` in the running text and in tables, where placeholders stand for arguments."""
    for page in PAGES:
        text = FENCE.sub("", page.read_text(encoding="utf-8"))
        for code in re.findall(r"`(sprintlab [^`]+)`", text):
            yield pytest.param(code.split()[1:], id=f"{page.name}: {code}")


@pytest.mark.parametrize("words", list(inline_commands()))
def test_command_in_the_text_exists(words):
    names = list(itertools.takewhile(lambda word: re.fullmatch(r"[a-z][a-z-]*", word), words))
    options = {word.split("=")[0] for word in words if word.startswith("--")}
    text = help_text(names[:2]) or help_text(names[:1])
    assert text, f"there is no sprintlab {' '.join(names)}"
    for option in options - {"--tyro-print-completion"}:
        assert option in text, f"no {option} in: {' '.join(words)}"


def help_text(names):
    """What ``--help`` prints; empty where the parser knows no such command."""
    with redirect_stdout(io.StringIO()) as output, redirect_stderr(io.StringIO()):
        try:
            parse([*names, "--help"])
        except SystemExit as stop:
            return output.getvalue() if stop.code in (0, None) else ""
    return ""


# --- Python blocks ------------------------------------------------------------------------------------------


def python_blocks():
    for page in PAGES:
        for number, (language, body) in enumerate(FENCE.findall(page.read_text(encoding="utf-8"))):
            if language == "python":
                yield pytest.param(body, id=f"{page.name}-{number}")


GUESTS = {
    f"sprintlab.integrations.{name}": package
    for name, package in {"newton": "newton", "isaaclab": "isaaclab", "playground": "jax"}.items()
}
"""Modules that need packages which the development install does not bring."""


@pytest.mark.parametrize("block", list(python_blocks()))
def test_python_of_the_pages_imports_what_exists(block):
    for node in ast.walk(ast.parse(block)):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("sprintlab"):
            if (node.module or "").startswith(LEARNING) and importlib.util.find_spec("torch") is None:
                continue
            guest = GUESTS.get(node.module or "")
            if guest is not None and importlib.util.find_spec(guest) is None:
                continue
            module = importlib.import_module(node.module)
            for alias in node.names:
                assert hasattr(module, alias.name) or importlib.util.find_spec(
                    f"{node.module}.{alias.name}"
                ), f"{node.module} has no {alias.name}"


@pytest.mark.parametrize("page", ["README.md", "docs/motors.md", "docs/train.md"])
def test_python_of_the_pages_runs(page, workplace, monkeypatch, capsys):
    monkeypatch.chdir(workplace)
    blocks = [
        body for language, body in FENCE.findall((ROOT / page).read_text("utf-8")) if language == "python"
    ]
    assert blocks
    for block in blocks:
        exec(compile(block, page, "exec"), {"__name__": "example"})
