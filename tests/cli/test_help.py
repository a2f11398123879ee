"""What somebody sees who types ``sprintlab`` for the first time, or mistypes it."""

import pytest

from sprintlab.cli.main import commands, grouped_help, main


def test_help_shows_every_command_once_in_a_group(capsys):
    assert main(["--help"]) == 0
    text = capsys.readouterr().out
    listed = [line.split()[0] for line in text.splitlines() if line.startswith("  ") and line[2] != " "]
    assert sorted(listed) == sorted(commands())


def test_help_fits_a_screen():
    lines = grouped_help().splitlines()
    assert len(lines) <= 50 and max(map(len, lines)) <= 110


def test_nothing_typed_shows_the_same_and_is_no_success(capsys):
    assert main([]) == 2
    assert "see it" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("typed", "meant"),
    [
        ("rase", "race"),
        ("trian", "train"),
        ("replays", "replay"),
        ("motor identfy bench.csv", "identify"),
        ("robot lst", "list"),
    ],
)
def test_a_mistyped_command_is_answered_with_the_nearest(typed, meant, capsys):
    assert main(typed.split()) == 2
    error = capsys.readouterr().err
    assert "did you mean" in error and meant in error and len(error.splitlines()) == 1


def test_words_far_from_any_command_get_the_list(capsys):
    assert main(["xyzzy"]) == 2
    assert "sprintlab --help lists" in capsys.readouterr().err
    assert main(["motor", "xyzzy"]) == 2
    assert "sprintlab motor --help lists" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "meant"),
    [
        (["race", "sprint", "--topspeed", "13"], "race has no option --topspeed: did you mean --top-speed?"),
        (["race", "sprint", "--outptu=here"], "race has no option --outptu: did you mean --output?"),
        (["motor", "envelope", "go1", "--figur", "x.png"], "no option --figur: did you mean --figure?"),
        (["train", "--envs", "16"], "train has no option --envs: did you mean --environments?"),
        (["train", "sprint", "--ppo.stepz", "3"], "no option --ppo.stepz: did you mean --ppo.steps?"),
    ],
)  # fmt: skip
def test_a_mistyped_option_is_answered_with_the_nearest(words, meant, capsys):
    if words[0] == "train":
        pytest.importorskip("torch")
    assert main(words) == 2
    error = capsys.readouterr().err
    assert meant in error and len(error.splitlines()) == 1
