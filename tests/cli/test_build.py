"""Commands made of functions: what is typed arrives, and nothing else."""

import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
import tyro

from sprintlab.api.tables import Printed
from sprintlab.cli.build import choice, command, group
from sprintlab.cli.main import parse
from sprintlab.cli.output import progress_bar

CONFIG = (tyro.conf.OmitArgPrefixes, tyro.conf.OmitSubcommandPrefixes, tyro.conf.FlagCreatePairsOff)


@dataclass(frozen=True, kw_only=True)
class Wind:
    """Air that moves.

    Attributes:
        gust: [m/s].
    """

    gust: float = 0.0


class Said(Printed):
    """The arguments of a call."""

    def __init__(self, given: dict[str, Any]) -> None:
        self.given = given

    def to_dict(self) -> dict[str, str]:
        return {name: repr(value) for name, value in self.given.items()}

    def tables(self) -> Iterator[str]:
        yield "said"


def measured(
    place: str | Path,
    count: int = 2,
    *,
    paths: Sequence[Path | str] = (),
    robot: str | Path | None = None,
    quick: bool = False,
    fair: bool = True,
    folder: Path | str | None = None,
    wind: Wind | None = None,
    progress: Callable[[str, float | None], None] = lambda what, share: None,
) -> Said:
    """Say what was given.

    Args:
        place: where.
        count: how often.
        paths: files.
        robot: its name.
        quick: or slow.
        fair: or not.
        folder: of the results.
        wind: of the day.
        progress: told what is done.

    Raises:
        ValueError: never.
    """
    progress("said", 1.0)
    return Said({name: value for name, value in locals().items() if name != "progress"})


Measured = command(measured, names={"folder": "output"}, status=lambda said: said.given["count"])


def given(capsys: pytest.CaptureFixture[str], kind: Any, *words: str) -> tuple[int, dict[str, str]]:
    """Exit status, and what the function got from a command line."""
    status = tyro.cli(kind, args=[*words, "--json"], config=CONFIG).run()
    return status, json.loads(capsys.readouterr().out)


def test_what_is_typed_arrives(capsys):
    words = "here --count 5 --paths a b --robot 7 --quick --no-fair --output runs --gust 3"
    assert given(capsys, Measured, *words.split()) == (
        5,
        {
            "place": "'here'",
            "count": "5",
            "paths": repr((Path("a"), Path("b"))),
            "robot": "'7'",
            "quick": "True",
            "fair": "False",
            "folder": repr(Path("runs")),
            "wind": "Wind(gust=3.0)",
        },
    )


def test_what_is_left_out_is_the_functions_default(capsys):
    status, found = given(capsys, Measured, "here")
    assert (status, found["paths"], found["robot"], found["folder"]) == (2, "()", "None", "None")
    assert (found["quick"], found["fair"], found["wind"]) == ("False", "True", "Wind(gust=0.0)")


def test_what_must_be_given_is_asked_for(capsys):
    with pytest.raises(SystemExit):
        tyro.cli(Measured, args=[], config=CONFIG)
    assert "required" in capsys.readouterr().err


def test_help_is_the_docstring_without_what_nobody_types(capsys):
    with pytest.raises(SystemExit):
        tyro.cli(Measured, args=["--help"], config=CONFIG)
    text = capsys.readouterr().out
    assert "Say what was given." in text and "of the results." in text and "of the day." in text
    assert "progress" not in text and "Raises" not in text and "--folder" not in text


def test_an_option_may_be_typed_once_for_each_of_its_values(capsys):
    kind = command(measured, repeated="paths")
    found = given(capsys, kind, "here", "--paths", "a", "--paths", "b=c")[1]
    assert found["paths"] == repr((Path("a"), Path("b=c")))


def test_a_group_runs_the_command_that_is_named(capsys):
    kind = group("Both.", {"first": Measured, "second": command(measured, positional=2)})
    assert given(capsys, kind, "second", "there", "4")[1]["count"] == "4"
    with pytest.raises(SystemExit):
        tyro.cli(choice({"one": kind, "two": Measured}), args=["one", "third"], config=CONFIG)


@pytest.mark.parametrize("required", ["", "count"])
def test_a_default_may_be_asked_for_all_the_same(required, capsys):
    kind = command(measured, required=required)
    if not required:
        assert given(capsys, kind, "here")[1]["count"] == "2"
        return
    with pytest.raises(SystemExit):
        tyro.cli(kind, args=["here"], config=CONFIG)
    assert "--count" in capsys.readouterr().err


@pytest.mark.parametrize("name", ["evaluate", "turning", "lap", "ground"])
def test_what_takes_minutes_asks_for_the_policy(name, capsys):
    with pytest.raises(SystemExit):
        parse([name])
    assert "policy" in capsys.readouterr().err
    assert parse([name, "sprint"]).policy == "sprint"


def test_progress_is_told_where_stderr_is_not_a_terminal(monkeypatch, capsys):
    monkeypatch.setattr("sprintlab.cli.output.LINE_SECONDS", 0.0)
    with progress_bar() as report:
        report("running trials", 0.5)
    with progress_bar(quiet=True) as report:
        report("in silence", 0.5)
    assert capsys.readouterr().err == "running trials: 50 %, about 0 s left\n"
