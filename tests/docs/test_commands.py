"""Every command in README and docs: run where it is quick, else parsed as the command line parses it.

A shell line is one of: ``sprintlab``, ``make``, ``pip``, ``python FILE``, ``python -m MODULE``, or a plain
shell word of ``SHELL``. Anything else fails, so that a new kind of line gets a check of its own.
"""

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
FENCE = re.compile(r"^ *```(\w*)[^\n]*\n(.*?)^ *```", re.MULTILINE | re.DOTALL)  # in lists they are indented
SHELL = {"cd", "git", "export", "source", "mkdir", "cp", "ls", "cat", "tar", "scp", "ssh", "."}
# Run as they stand, in a folder that holds the files of ``workplace``; everything else is only parsed.
QUICK = ("robot show", "robot list", "motor show", "motor envelope", "replay")


def blocks(page, *languages):
    return [body for language, body in FENCE.findall(page.read_text("utf-8")) if language in languages]


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


LINES = list(
    dict.fromkeys(
        (page, words)
        for page in PAGES
        for block in blocks(page, "sh", "bash", "console")
        for line in re.sub(r"\\\n\s*", " ", textwrap.dedent(block)).splitlines()
        for words in commands_in(line)
    )
)


def identity(value):
    return " ".join(value) if isinstance(value, tuple) else value.name


@pytest.fixture(scope="module")
def workplace(tmp_path_factory):
    """A folder with what the pages take for granted: a motor, a policy, a robot, the runs that they name."""
    folder = tmp_path_factory.mktemp("docs")
    motors = load_robot("bp2").motors
    hip = {item.name: float(np.ravel(getattr(motors, item.name))[1]) for item in fields(motors)}
    save_motor(PmsmParameters(**hip), folder / "my-motor.toml")
    shutil.copy(shipped_policy(), folder / "my-policy.onnx")
    (folder / "examples").symlink_to(GO1.parent)
    choices = {**read_choices(GO1 / "choices.toml"), "name": "mydog"}
    import_robot(GO1 / "go1.xml", make_choices(choices, "choices.toml"), folder / "robots")
    for run in {match for _, words in LINES for match in re.findall(r"runs/race-[\d-]+", " ".join(words))}:
        (folder / run).mkdir(parents=True)
        np.savez(folder / run / "trajectory.npz", **standing_still())
    np.savez(folder / "lap.npz", **standing_still())
    return folder


def standing_still(count=100):
    """A recording of a robot at rest."""
    posture = np.zeros((count, 23))
    posture[:, 2:4] = 0.5, 1.0
    joints = {name: np.zeros((count, 12)) for name in ("joint_velocity", "motor_torque", "joint_torque")}
    limits = {"torque_lower": np.full((count, 12), -1.0), "torque_upper": np.full((count, 12), 1.0)}
    plane = {"velocity": np.zeros((count, 2)), "command": np.zeros((count, 3))}
    return {"time": np.arange(count) / 500.0, "qpos": posture, **joints, **limits, **plane}


@pytest.mark.parametrize(("page", "words"), LINES, ids=identity)
def test_command_of_the_pages_works(page, words, workplace, monkeypatch):
    monkeypatch.chdir(workplace)
    program, *arguments = words
    if program == "sprintlab":
        check_sprintlab(arguments)
    elif program in ("pip", "uv"):
        project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
        for extras in re.findall(r"\[([\w,-]+)\]", " ".join(arguments)):
            assert set(extras.split(",")) <= set(project["optional-dependencies"])
    elif program == "make":
        subprocess.run(["make", "--dry-run", *arguments], cwd=ROOT, capture_output=True, check=True)
    elif program.startswith("python"):
        check_python(arguments)
    else:
        assert program in SHELL, f"{page.name}: no test knows what to do with: {' '.join(words)}"


def check_sprintlab(arguments):
    if " ".join(arguments).startswith(QUICK):
        with redirect_stdout(io.StringIO()) as output:
            assert main(arguments) == 0
        assert output.getvalue().strip()
    elif "--help" in arguments:
        assert help_text(arguments)
    elif not arguments[0].startswith("--"):
        _, given = parse(arguments)
        if arguments[0] == "train" and importlib.util.find_spec("torch"):
            from sprintlab.training.methods import method
            from sprintlab.training.settings_text import with_changes

            base = method(given["method"] or "acs", robot=given["robot"] or "bp2", preset=given["preset"])
            with_changes(base, given["set"])


def check_python(arguments):
    """The script or module is there and names each option."""
    if arguments[0] != "-m":
        source = next(path for path in (ROOT / arguments[0], Path(arguments[0])) if path.is_file())
    elif arguments[1].startswith("sprintlab"):
        source = Path(importlib.util.find_spec(arguments[1]).origin)
    else:
        return
    text = source.read_text("utf-8")
    for option in (word.split("=")[0].removeprefix("--") for word in arguments if word.startswith("--")):
        assert option in text or option.replace("-", "_") in text, f"{source.name} does not know --{option}"


def inline_commands():
    """``sprintlab ...`` in the running text and in tables, where placeholders stand for arguments."""
    for page in (*PAGES, ROOT / "src/sprintlab/robots/README.md"):
        for code in re.findall(r"`(sprintlab [^`]+)`", FENCE.sub("", page.read_text("utf-8"))):
            yield pytest.param(code.split()[1:], id=f"{page.name}: {code}")


@pytest.mark.parametrize("words", list(inline_commands()))
def test_command_in_the_text_exists(words):
    names = list(itertools.takewhile(lambda word: re.fullmatch(r"[a-z][a-z-]*", word), words))
    text = help_text(names[:2]) or help_text(names[:1])
    assert text, f"there is no sprintlab {' '.join(names)}"
    for option in {word.split("=")[0] for word in words if word.startswith("--")}:
        assert option in text or option == "--tyro-print-completion", f"no {option} in: {' '.join(words)}"


def help_text(names):
    """What ``--help`` prints; empty where the parser knows no such command."""
    with redirect_stdout(io.StringIO()) as output, redirect_stderr(io.StringIO()):
        try:
            parse([*names, "--help"])
        except SystemExit as stop:
            return output.getvalue() if stop.code in (0, None) else ""
    return ""


@pytest.mark.parametrize("page", ["README.md", "docs/motors.md", "docs/speed-limit.md", "docs/train.md"])
def test_python_of_the_pages_runs(page, workplace, monkeypatch):
    monkeypatch.chdir(workplace)
    found = blocks(ROOT / page, "python")
    assert found
    for block in found:
        exec(compile(block, page, "exec"), {"__name__": "example"})
