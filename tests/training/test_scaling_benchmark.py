"""The scaling benchmark starts what users start, and reckons efficiency as its table says."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import pytest

pytest.importorskip("mujoco_warp")

import tyro

from sprintlab.cli.train import method_as_option
from sprintlab.core.errors import InvalidValueError, SprintlabError
from sprintlab.training.runs.run import TrainOptions


@pytest.fixture
def benchmark_module(load_script: Callable[[str], ModuleType]) -> ModuleType:
    return load_script("benchmarks/training_scaling.py")


@pytest.mark.parametrize("processes", [1, 3])
def test_its_trainings_are_commands_that_sprintlab_takes(
    benchmark_module: ModuleType, processes: int, tmp_path: Path
) -> None:
    chosen = benchmark_module.parse(["--processes", "1,3", "--iterations", "7", "--device", "cpu"])
    words = benchmark_module.training_command(processes, 64, chosen, tmp_path)
    assert ("--nproc-per-node" in words) == (processes > 1)
    after = words[words.index("train") + 1 :]
    command = tyro.cli(TrainOptions, args=method_as_option(after))
    assert command.iterations == 7 + benchmark_module.SETTLING
    assert command.environments == 64 and command.settings.ppo.precision == "bfloat16"


def test_efficiency_is_the_rate_over_that_of_separate_processes(benchmark_module: ModuleType) -> None:
    rows = [
        {"processes": 1, "steps_per_second": 100.0},
        {"processes": 2, "steps_per_second": 180.0},
        {"processes": 4, "steps_per_second": 300.0},
    ]
    assert [row["efficiency"] for row in benchmark_module.with_efficiency(rows)] == [1.0, 0.9, 0.75]


@pytest.mark.parametrize(
    "arguments", [["--processes", "0,2"], ["--environments", "1"], ["--iterations", "0"], ["--minutes", "0"]]
)
def test_numbers_out_of_range_are_refused(benchmark_module: ModuleType, arguments: list[str]) -> None:
    with pytest.raises(InvalidValueError, match="not allowed"):
        benchmark_module.parse(arguments)


def test_what_is_done_is_written_before_the_last_case_fails(
    benchmark_module: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def rate(command: list[str], folder: Path, minutes: float) -> float:
        if "torch.distributed.run" not in command:
            raise SprintlabError("one is too few")
        return 100.0

    monkeypatch.setattr(benchmark_module, "rate", rate)
    output = tmp_path / "scaling.json"
    chosen = benchmark_module.parse(["--processes", "1,2", "--device", "cpu", "--output", str(output)])
    with pytest.raises(SprintlabError, match="one is too few"):
        benchmark_module.measure(chosen)
    (row,) = json.loads(output.read_text())["rows"]
    assert row["steps_per_second"] == 100.0 and row["processes"] == 2  # the largest comes first


def test_a_training_that_takes_too_long_is_stopped_and_quoted(
    benchmark_module: ModuleType, tmp_path: Path
) -> None:
    command = [sys.executable, "-uc", "import time; print('preparing'); time.sleep(600)"]
    with pytest.raises(SprintlabError, match=r"not done after 0\.05 min; it said: preparing"):
        benchmark_module.rate(command, tmp_path / "run", 0.05)
    with pytest.raises(SprintlabError, match="failed: no room"):
        benchmark_module.rate([sys.executable, "-c", "raise SystemExit('no room')"], tmp_path / "run", 1.0)
