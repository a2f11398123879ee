"""docs/motors.md: the commands from a sheet or a bench to a motor file print what the page shows."""

import re
import shlex
import shutil
from pathlib import Path

import pytest

from sprintlab.cli.main import main

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs" / "motors.md").read_text(encoding="utf-8")
TEXT = PAGE[PAGE.index("## A motor file") : PAGE.index("## How well it predicts")]
FENCE = re.compile(r"^```(\w*)\n(.*?)^```", re.MULTILINE | re.DOTALL)


def words(line):
    return " ".join(line.split())


def steps():
    """``(commands, printed lines)``: a shell block, and the text block that follows it if one does."""
    blocks = [(found.start(), *found.groups()) for found in FENCE.finditer(TEXT)]
    for (_, language, body), (_, following, printed) in zip(blocks, [*blocks[1:], (0, "", "")], strict=True):
        if language == "sh":
            shown = printed.splitlines() if following == "text" else []
            yield body.splitlines(), [words(line) for line in shown]


@pytest.fixture
def workplace(tmp_path, monkeypatch):
    """The repository's examples."""
    shutil.copytree(ROOT / "examples" / "motors", tmp_path / "examples" / "motors")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_every_command_of_the_page_prints_what_the_page_shows(workplace, capsys):
    count = 0
    for commands, shown in steps():
        output, status = "", 0
        for command in commands:
            program, *arguments = shlex.split(command)
            assert program == "sprintlab"
            status = main(arguments)
            captured = capsys.readouterr()
            output += captured.out + captured.err
            count += 1
        refused = any(line.startswith("sprintlab:") for line in shown)
        assert status == (2 if refused else 0), (commands, output)
        printed = {words(line) for line in output.splitlines()}
        assert set(shown) <= printed, commands
    assert count == 7
    for name in ("my-motor.toml", "envelope.png", "found.toml", "fit.png"):
        assert (workplace / name).stat().st_size > 0
