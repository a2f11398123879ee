"""What a training shows: its table fits 80 columns, and output that is no terminal gets lines."""

from __future__ import annotations

import io

import pytest
import torch
from rich.console import Console
from tests.training.small import small_settings

from sprintlab.training import exam as exam_module
from sprintlab.training.runs import progress
from sprintlab.training.runs.runner import Runner
from sprintlab.training.runs.screen import screen
from sprintlab.training.settings import ExamSettings

SETTINGS = small_settings(exam=ExamSettings(interval=1))


@pytest.fixture(scope="module")
def row() -> dict[str, float]:
    """A row of the log with an exam."""
    torch.set_num_threads(1)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(exam_module, "HOLD", 0.1)
        patch.setattr(exam_module, "REST", 0.1)
        return Runner(SETTINGS, "cpu", "test").iterate()


def printed(row: dict[str, float], height: int) -> str:
    console = Console(width=80, file=io.StringIO(), force_terminal=False)
    exam = {name: value for name, value in row.items() if name.startswith("exam/") or name == "iteration"}
    console.print(screen("bp2, method sprint", row, exam, 0.2, 50.0, height))
    assert isinstance(console.file, io.StringIO)
    return console.file.getvalue()


@pytest.mark.parametrize("factor", [1.0, 1e-6, 100.0])
def test_the_table_is_as_wide_as_a_terminal(row: dict[str, float], factor: float) -> None:
    """Whatever the numbers are; and nothing but the terms is left out of a low terminal."""
    scaled = {name: value * factor for name, value in row.items()}
    high, low = printed(scaled, 60), printed(scaled, 10)
    assert max(map(len, high.splitlines())) <= 80
    assert "by term" in high and "by term" not in low
    for text in (high, low):
        assert "…" not in text
        for words in ("time left", "physics alone", "episode length", "foot force [body weights]"):
            assert words in text


def test_without_a_terminal_lines_come_now_and_then(row: dict[str, float], capsys) -> None:
    with progress.Reporter("", 0.0, None) as reporter:
        without = {name: value for name, value in row.items() if not name.startswith("exam/")}
        for iteration in (1.0, 2.0, 3.0):
            reporter.show({**without, "iteration": iteration}, 0.1 * iteration)
        reporter.show({**row, "iteration": 4.0}, 0.4)
    lines = capsys.readouterr().err.splitlines()
    assert [line.split(",")[0] for line in lines] == ["iteration 1", "exam at iteration 4", "iteration 4"]
    assert "left" in lines[0] and "limits failed" in lines[1]
