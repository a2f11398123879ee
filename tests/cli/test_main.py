"""The command line itself: what is typed arrives, help, mistyped words, status and progress."""

import json
import os
import subprocess
import sys

import pytest

from sprintlab.api.results import Drawn, Result
from sprintlab.cli import main as entry
from sprintlab.cli.main import ALL, grouped_help, parse, run_command
from sprintlab.cli.output import progress_bar
from sprintlab.core.errors import UnwrittenError

HEAVY = ("mujoco", "torch", "onnxruntime", "matplotlib", "numpy", "warp")


def test_what_is_typed_arrives_as_the_function_takes_it(call):
    _, given = parse(["race", "sprint", "--top-speed", "5", "--no-report", "--battery"])
    assert (given["policy"], given["top_speed"], given["report"]) == ("sprint", 5.0, False)
    assert given["drive"].battery and not given["drive"].heat
    _, given = parse(["sweep", "runs", "--methods", "acs", "baseline", "--set", "a=1", "--set", "b=2"])
    assert (given["methods"], given["set"]) == (("acs", "baseline"), ("a=1", "b=2"))
    missing, wrong = call("export"), call("race", "--top-speed", "fast")
    assert missing.status == 2 and "required" in missing.err
    assert wrong.status == 2 and "could not convert string to float" in wrong.err
    assert "NoneType" not in wrong.err


def test_a_result_is_printed_also_where_its_file_cannot_be_written(capsys):
    def fails() -> Result:
        error = UnwrittenError("no room")
        error.found = Result(numbers={"speed": float("nan")}, shown=["slow"])
        raise error

    with pytest.raises(UnwrittenError):
        run_command(fails, {"json": True})
    assert json.loads(capsys.readouterr().out) == {"speed": None}
    with pytest.raises(UnwrittenError):
        run_command(fails, {"json": False})
    assert capsys.readouterr().out == "slow\n"


def test_a_figure_is_refused_before_the_work_and_drawn_after_it(tmp_path, capsys):
    from matplotlib.figure import Figure

    def drawn() -> Drawn:
        return Drawn(numbers={}, shown=[], draw=lambda: Figure())

    with pytest.raises(Exception, match=r"\.png"):
        run_command(drawn, {"json": True, "figure": tmp_path / "a.jpg"})
    run_command(drawn, {"json": True, "figure": tmp_path / "a.png"})
    assert json.loads(capsys.readouterr().out) == {"figure": str(tmp_path / "a.png")}
    assert (tmp_path / "a.png").read_bytes().startswith(b"\x89PNG")


def test_help_imports_nothing_heavy_and_lists_every_command_once():
    code = (
        "import contextlib, io, sys, sprintlab.cli.main as m\n"
        "with contextlib.suppress(SystemExit): m.main(['--help'])\n"
        "with contextlib.redirect_stdout(io.StringIO()):\n"
        "    for name in m.ALL:\n"
        "        with contextlib.suppress(SystemExit): m.main([name, '--help'])\n"
        f"print([name for name in {HEAVY} if name in sys.modules], file=sys.stderr)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stderr.strip() == "[]"
    lines = done.stdout.splitlines()
    listed = [line.split()[0] for line in lines if line.startswith("  ") and line[2] != " "]
    assert sorted(listed) == sorted(ALL) and len(lines) <= 50 and max(map(len, lines)) <= 110


def test_nothing_typed_shows_the_commands_and_is_no_success(call):
    assert call() == (2, grouped_help() + "\n", "")
    motor = call("motor")
    assert motor.status == 2 and "identify" in motor.out and call("motor", "--help").status == 0


@pytest.mark.parametrize(
    ("typed", "meant"),
    [
        ("rase", "did you mean race"),
        ("motor identfy bench.csv", "did you mean identify"),
        ("xyzzy", "sprintlab --help lists"),
    ],
)
def test_a_mistyped_word_is_answered_with_the_nearest(typed, meant, call):
    outcome = call(*typed.split())
    assert outcome.status == 2 and meant in outcome.err and len(outcome.err.splitlines()) == 1


def test_a_reader_that_leaves_early_is_no_error():
    shell = f"{sys.executable} -m sprintlab.cli.main robot show | head -1; exit ${{PIPESTATUS[0]}}"
    done = subprocess.run(["bash", "-c", shell], capture_output=True, text=True, env=os.environ, check=False)
    assert done.returncode == 0 and "Traceback" not in done.stderr


def test_an_interruption_ends_with_130(call, monkeypatch):
    def interrupt(_):
        raise KeyboardInterrupt

    monkeypatch.setattr(entry, "run_words", interrupt)
    assert call("race") == (130, "", "sprintlab: interrupted\n")


def test_progress_is_told_where_stderr_is_not_a_terminal(monkeypatch, capsys):
    monkeypatch.setattr("sprintlab.cli.output.time.monotonic", iter((0.0, 10.0, 20.0, 40.0)).__next__)
    with progress_bar() as report:
        report("sprint 1 of 4", 0.25)
        report("sprint 2 of 4", 0.5)
        report("drawing", None)
    with progress_bar(quiet=True) as report:
        report("in silence", 0.5)
    lines = ["sprint 1 of 4: 25 %, about 30 s left", "sprint 2 of 4: 50 %, about 20 s left", "drawing"]
    assert capsys.readouterr().err.splitlines() == lines
