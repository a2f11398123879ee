"""How training speed grows with the number of GPUs: weak and strong scaling through torchrun.

    python benchmarks/training_scaling.py --processes 1,2,4 --output results/throughput/scaling.json

Weak: each process has ``--environments`` robots. Strong: all processes together have as many. Each case is a
training of its own; the rate is the median over its iterations but the first ``SETTLING``.
"""

from __future__ import annotations

import argparse
import json
import os
import shlex
import signal
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from harness import answer, circumstances
from rich.console import Console
from rich.progress import track
from rich.table import Table

from sprintlab.core.checks import check_positive, check_range
from sprintlab.core.errors import SprintlabError
from sprintlab.core.files import atomic_write_json
from sprintlab.training.runs.run import pick_device
from sprintlab.training.runs.runner import device_description
from sprintlab.training.settings import PRECISIONS

PACKAGES = ("sprintlab", "torch", "warp-lang", "mujoco-warp")
SETTLING = 5
"""Iterations before the clock counts: robots are standing, memory is being found."""
KINDS = ("weak", "strong")


def training_command(
    processes: int, environments: int, chosen: argparse.Namespace, folder: Path
) -> list[str]:
    """One training of ``processes`` with ``environments`` robots each."""
    torchrun = ["torch.distributed.run", "--standalone", "--local-addr", "127.0.0.1"]
    torchrun += ["--nproc-per-node", str(processes), "-m"]
    options = {
        "output": folder,
        "iterations": SETTLING + chosen.iterations,
        "environments": environments,
        "device": chosen.device,
        "settings.ppo.precision": chosen.precision,
    }
    words = [word for name, value in options.items() for word in (f"--{name}", str(value))]
    program = [*(torchrun if processes > 1 else []), "sprintlab", "train", "sprint"]
    return [sys.executable, "-m", *program, *words, "--no-tensorboard", "--no-cloud", "--no-keep-robots"]


def rate(command: list[str], folder: Path, minutes: float) -> float:
    """Environment steps a second of all processes together.

    Raises:
        SprintlabError: the training failed, or was not done in time; its last words.
    """
    said = folder.parent / "said.txt"
    status = finished(command, said, 60.0 * minutes)
    words = said.read_text(errors="replace").strip()[-1000:]
    if status is None:
        raise SprintlabError(f"{shlex.join(command)} was not done after {minutes:g} min; it said: {words}")
    if status:
        raise SprintlabError(f"{shlex.join(command)} failed: {words}")
    rows = [json.loads(line) for line in (folder / "log.jsonl").read_text().splitlines()]
    return statistics.median(row["steps_per_second"] for row in rows[SETTLING:])


def finished(command: list[str], said: Path, seconds: float) -> int | None:
    """Exit status of a command; None where it took too long: then all of its processes are stopped."""
    environment = {**os.environ, "MUJOCO_GL": "disabled"}
    with said.open("w") as output:
        process = subprocess.Popen(
            command, stdout=output, stderr=output, env=environment, start_new_session=True
        )
        try:
            return process.wait(timeout=seconds)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()
            return None


def measure_case(kind: str, processes: int, chosen: argparse.Namespace) -> dict[str, Any]:
    """One row of the table."""
    each = chosen.environments if kind == "weak" else chosen.environments // processes
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name) / "run"
        command = training_command(processes, each, chosen, folder)
        return {
            "kind": kind,
            "processes": processes,
            "environments_each": each,
            "steps_per_second": rate(command, folder, chosen.minutes),
        }


def with_efficiency(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """The rate over what as many separate processes as the fewest measured would do."""
    least = min(rows, key=lambda row: row["processes"])
    alone = least["steps_per_second"] / least["processes"]
    return [{**row, "efficiency": row["steps_per_second"] / (alone * row["processes"])} for row in rows]


def measure(chosen: argparse.Namespace) -> dict[str, Any]:
    """Every number of processes, weak and strong; one process is both.

    The largest comes first: it compiles for all GPUs, and the others find their kernels ready. What is done
    is in ``--output`` after every case: a machine that is lent for minutes may not see the last.
    """
    counts = chosen.processes
    cases = [(kind, count) for kind in KINDS for count in counts if kind == "weak" or count > 1]
    result = {
        "device": device_description(pick_device(chosen.device)),
        **circumstances(PACKAGES),
        "precision": chosen.precision,
        "iterations": chosen.iterations,
        "rows": [],
    }
    rows: list[dict[str, Any]] = []
    for case in track(cases, "trainings", console=Console(stderr=True)):
        rows.append(measure_case(*case, chosen))
        result["rows"] = with_efficiency(rows)
        if chosen.output is not None:
            atomic_write_json(chosen.output, result)
    return result


def show(result: dict[str, Any]) -> None:
    """A table of the cases."""
    table = Table("scaling", "processes", "robots each", "steps/s", "efficiency", title=result["device"])
    for row in result["rows"]:
        counts = (str(row["processes"]), str(row["environments_each"]))
        speeds = (f"{row['steps_per_second']:,.0f}", f"{100 * row['efficiency']:.0f} %")
        table.add_row(row["kind"], *counts, *speeds)
    Console().print(table)


def process_counts(text: str) -> tuple[int, ...]:
    """Numbers of processes from ``1,2,4``, the largest first."""
    try:
        return tuple(sorted({int(part) for part in text.split(",")}, reverse=True))
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is not allowed: numbers such as 1,2,4") from None


def parse(arguments: list[str] | None = None) -> argparse.Namespace:
    """The command line, checked."""
    parser = argparse.ArgumentParser(description="Weak and strong scaling of training over GPUs.")
    parser.add_argument("--processes", type=process_counts, default=(2, 1), help="such as 1,2,4")
    parser.add_argument("--environments", type=int, default=8192)
    parser.add_argument("--iterations", type=int, default=60, help="timed, of each training")
    parser.add_argument("--minutes", type=float, default=10.0, help="the most that a training may take")
    parser.add_argument("--precision", choices=PRECISIONS, default="bfloat16")
    parser.add_argument("--device", default="auto")
    parser.add_argument("--output", type=Path, help="JSON file")
    parser.add_argument("--json", action="store_true", help="print JSON instead of a table")
    chosen = parser.parse_args(arguments)
    check_range("processes", min(chosen.processes), 1, 10**4)
    check_range("environments", chosen.environments, 2 * max(chosen.processes), 10**6)
    check_range("iterations", chosen.iterations, 1, 10**4)
    check_positive("minutes", chosen.minutes, "min")
    return chosen


if __name__ == "__main__":
    sys.exit(answer(parse, measure, show))
