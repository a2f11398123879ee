"""What cannot work is refused before any work, without PyTorch or matplotlib; doctor answers at once."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

import sprintlab

SOURCE = Path(sprintlab.__file__).parents[1]
WITHOUT_TORCH = """
import contextlib, importlib.util, io, json, os, sys

class Refuse:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in ("torch", "warp", "mujoco_warp", "matplotlib"):
            raise SystemExit(f"imported {name}")

importlib.util.find_spec = lambda name, *rest: object()
sys.meta_path.insert(0, Refuse())
from sprintlab.cli.main import main

def answer(folder, words):
    os.chdir(folder)
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            status = main(words)
        except SystemExit as stop:
            status = stop.code
    return status, out.getvalue(), err.getvalue()

print(json.dumps([answer(folder, words) for folder, words in json.load(sys.stdin)]))
"""


def answers(*commands: tuple[Path, Sequence[str]]) -> list[list[Any]]:
    """Status, output and errors of commands, each in its folder, one after the other in one process.

    The first module of PyTorch that a command imports ends that command.
    """
    done = subprocess.run(
        [sys.executable, "-c", WITHOUT_TORCH], input=json.dumps([(str(at), words) for at, words in commands]),
        stdout=subprocess.PIPE, text=True, env={**os.environ, "PYTHONPATH": str(SOURCE)}, check=True,
    )  # fmt: skip
    return json.loads(done.stdout)


REFUSED = (
    (["train", "gallop"], "method"),
    (["train", "sprint", "--minutes", "-1"], "minutes"),
    (["train", "sprint", "--robot", "nodog"], "nodog"),
    (["train", "sprint", "--resume", "--output", "none"], "nothing to resume"),
    (["train", "sprint", "--device", "gpu"], "device"),
    (["train", "sprint", "--output", "file/run"], "cannot write"),
    (["export", "none.pt", "policy.onnx"], "none.pt"),
    (["export", "junk.pt", "policy.onnx"], "junk.pt"),
    (["learning", "none"], "none"),
    (["learning", "junk.pt"], "junk.pt"),
    (["race", "--top-speed", "1e9"], "top_speed"),
    (["race", "--top-speed", "nan"], "top_speed"),
    (["race", "--output", "file/run"], "cannot write"),
    (["race", "nosuch"], "nosuch"),
    (["race", "--workers", "0"], "workers"),
    (["robustness", "--trials", "0"], "trials"),
    (["robustness", "--distance", "-5"], "distance"),
    (["evaluate", "sprint", "--output", "file/numbers.json"], "cannot write"),
    (["report", "none.mcap", "--output", "lost"], "lost exists already"),
    (["report", "none.mcap", "--output", "file/report"], "cannot write"),
    (["race", "--output", "lost"], "lost exists already"),
    (["race", "--output", "loop/run"], "cannot write"),
    (["evaluate", "sprint", "--output", "loop"], "cannot write"),
    (["evaluate", "sprint", "--output", "loop/numbers.json"], "cannot write"),
    (["evaluate", "sprint", "--output", "."], "it is a folder"),
    (["evaluate", "sprint", "--output", "pipe"], "a pipe, a device or an open file"),
    (["evaluate", "sprint", "--output", "n" * 300], "File name too long"),
    (["limit", "--figure", "pipe.png"], "a pipe, a device or an open file"),
    (["limit", "--figure", "loop.png"], "cannot write"),
    (["limit", "--results", "pipe"], "there is no folder pipe"),
    (["motor", "identify", "no-bench.csv", "--output", "loop/motor.toml"], "cannot write"),
    (["replay", "no-run", "--output", "loop"], "cannot write"),
    (["robot-sim", "shm://nobody", "--duration", "1", "--truth", "loop/truth.npz"], "cannot write"),
    (["robot-sim", "shm://nobody", "--duration", "1", "--truth", "truth.csv"], "truth's ending"),
    (
        ["robot-sim", "shm://nobody", "--duration", "1e9", "--truth", "t.npz"],
        "duration of a truth = 1000000000.0",
    ),
    (
        ["robot-sim", "shm://nobody", "--duration", "1e308", "--truth", "t.npz"],
        "duration of a truth = 1e+308",
    ),
)


@pytest.fixture(scope="module")
def refusals(tmp_path_factory: pytest.TempPathFactory) -> dict[tuple[str, ...], tuple[Path, list[Any]]]:
    """By command: the folder in which it was typed, and its answer."""
    folders = [tmp_path_factory.mktemp("typed") for _ in REFUSED]
    for folder in folders:
        (folder / "junk.pt").write_bytes(b"no checkpoint")
        (folder / "file").write_text("")
        (folder / "lost").symlink_to("nowhere")
        for name in ("loop", "loop.png"):
            (folder / name).symlink_to(name)
        for name in ("pipe", "pipe.png"):
            os.mkfifo(folder / name)
    commands = [words for words, _ in REFUSED]
    told = answers(*zip(folders, commands, strict=True))
    return {tuple(words): found for words, *found in zip(commands, folders, told, strict=True)}


@pytest.mark.parametrize(("words", "said"), REFUSED)
def test_refused_before_any_work(refusals, words: list[str], said: str) -> None:
    folder, (status, out, err) = refusals[tuple(words)]
    assert (status, out) == (2, ""), err
    assert err.startswith("sprintlab: ") and err.count("\n") == 1
    assert said in err
    assert sorted(os.listdir(folder)) == ["file", "junk.pt", "loop", "loop.png", "lost", "pipe", "pipe.png"]


def test_doctor_imports_nothing_that_takes_long(tmp_path: Path) -> None:
    [[_, out, err]] = answers((tmp_path, ["doctor", "--json"]))
    assert '"not tried"' in out and "imported" not in err + out


@pytest.mark.usefixtures("not_installed")
def test_versions_are_known_without_installed_metadata() -> None:
    from sprintlab.core.extras import package_version

    assert package_version("sprintlab") == sprintlab.__version__


@pytest.mark.usefixtures("not_installed")
def test_a_race_from_a_source_tree_names_its_versions() -> None:
    from sprintlab.core.extras import package_version
    from sprintlab.evaluation import race_files

    assert [package_version(name) for name in race_files.SOFTWARE].count(sprintlab.__version__) == 1
