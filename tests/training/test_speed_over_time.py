"""Speed over time tells what was held, and apart from it whether the robot also braked and stood."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest

pytest.importorskip("mujoco_warp")

from sprintlab.evaluation.protocol import ProtocolSettings

SETTINGS = ProtocolSettings(trials=5, required=4)
HOLD = (4.0, 8.0)
COMMITTED = Path(__file__).parents[2] / "results" / "throughput" / "speed_over_time.json"


@pytest.fixture
def benchmark_module(load_script: Callable[[str], ModuleType]) -> ModuleType:
    return load_script("benchmarks/speed_over_time.py")


class Pool:
    """Trials that fell at given times [s], or not; each holds its number in m/s."""

    def __init__(self, *falls: float | None) -> None:
        self.falls = falls

    def trials(self, requests: list[Any], most_falls: int | None = None) -> list[SimpleNamespace]:
        uncut = most_falls is None or len(self.falls) <= most_falls
        assert len(requests) == len(self.falls) and uncut, "a fall must not cut the trials short"
        return [
            SimpleNamespace(
                fall_time=fall,
                completed=fall is None,
                hold_interval=HOLD,
                metrics=SimpleNamespace(held_speed=float(number)),
            )
            for number, fall in enumerate(self.falls)
        ]


@pytest.mark.parametrize(
    ("falls", "held", "passed", "completed"),
    [
        ((None, None, None, None, None), 2.0, True, True),
        ((None, 9.0, 9.0, 9.0, None), 2.0, True, False),
        ((2.0, None, None, None, None), 2.5, True, True),
        ((2.0, None, None, None, 7.9), 2.0, False, False),
        ((1.0, 1.0, 1.0, 1.0, 1.0), 0.0, False, False),
    ],
)
def test_a_fall_after_the_hold_is_no_fall_in_it(
    benchmark_module: ModuleType, falls: tuple[float | None, ...], held: float, passed: bool, completed: bool
) -> None:
    result = benchmark_module.hold_speed(Pool(*falls), 6.0, SETTINGS)
    assert (result.held, result.passed, result.completed) == (held, passed, completed)
    assert result.top_speed == 6.0


def test_the_file_tells_where_policies_were_trained_and_how_they_were_evaluated(
    benchmark_module: ModuleType, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    (committed,) = json.loads(COMMITTED.read_text())["runs"]
    (tmp_path / "milestones").mkdir()
    for point in range(len(committed["milestones"])):
        (tmp_path / "milestones" / f"{point:02}.pt").touch()
    rows = iter(committed["milestones"])
    monkeypatch.setattr(benchmark_module, "run_facts", lambda run: committed["facts"])
    monkeypatch.setattr(benchmark_module, "measure_milestone", lambda *_: next(rows))
    figure = tmp_path / "speeds.png"
    monkeypatch.setattr(
        "sys.argv", ["speed_over_time.py", str(tmp_path), "--workers", "1", "--figure", str(figure)]
    )
    result = benchmark_module.measure(benchmark_module.parse())
    assert result["runs"] == [committed]
    assert set(committed["facts"]) >= {"device", "versions", "command_line", "date"}
    assert result["command_line"].startswith(f"speed_over_time.py {tmp_path}")
    assert set(result["packages"]) == set(benchmark_module.EVALUATION_PACKAGES)
    assert set(json.loads(COMMITTED.read_text())) <= set(result)
    assert figure.read_bytes().startswith(b"\x89PNG")
