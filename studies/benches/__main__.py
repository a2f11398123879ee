"""``python -m studies.benches bench-data``: every number and figure of docs/motors.md."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from tools.fetch_bench_data import SOURCES

from sprintlab.cli.output import exit_status
from sprintlab.core.files import atomic_write_json, check_writable, check_writable_file
from studies.benches.figures import heat_figure, torque_figure
from studies.benches.heat import heat_rows
from studies.benches.laws import compared, compared_saturation
from studies.benches.predictions import Split, predicted, splits

SATURATION_SPLITS = (
    "motor 1, stalled, first half: second half",
    "motor 1, stalled on 27 April: 13 May",
    "odd rows: even rows",
    "below 200 rad/s: above",
    "up to 25 A: 25 to 54 A",
    "steps of 35 to 140 N m: steps of 140 N m",
    "steps of 35 to 140 N m: position of 42 sines to 10 Hz",
)
"""Where the laws of saturation are compared: within a log, on another day, at other speeds and currents."""

GEAR_SPLITS = (
    "steps of 35 to 140 N m: steps of 140 N m",
    "steps of 35 to 140 N m: position of 42 sines to 10 Hz",
)
SHOWN = ("motor 1, stalled on 27 April: 13 May", "below 200 rad/s: above", GEAR_SPLITS[0])
"""One split per motor, in the figure."""


def study(folder: Path, parts: Sequence[Split]) -> dict[str, Any]:
    """All numbers of the page."""
    named = {split.name: split for split in parts}
    return {
        "made_by": "python -m studies.benches",
        "sources": {
            key: {"repository": source.repository, "commit": source.commit, "terms": source.terms}
            for key, source in SOURCES.items()
        },
        "predictions": [predicted(split) for split in parts],
        "saturation": [compared_saturation(named[name]) for name in SATURATION_SPLITS],
        "gear": [compared(named[name]) for name in GEAR_SPLITS],
        "heat": heat_rows(folder),
    }


def main(arguments: Sequence[str] | None = None) -> int:
    """Write the numbers and the figures; a refusal is one sentence on stderr and status 2."""
    parser = argparse.ArgumentParser(prog="python -m studies.benches", description=__doc__)
    parser.add_argument("data", type=Path, help="folder that tools/fetch_bench_data.py filled")
    parser.add_argument("--output", type=Path, default=Path("results/benches/benches.json"))
    parser.add_argument("--figures", type=Path, default=Path("docs/figures"))
    chosen = parser.parse_args(arguments)
    return exit_status("studies.benches", lambda: write(chosen.data, chosen.output, chosen.figures))


def write(data: Path, out: Path, figures: Path) -> int:
    """Compute and write; returns the exit status.

    Args:
        data: folder that ``tools/fetch_bench_data.py`` filled.
        out: file of the numbers (JSON).
        figures: folder of the figures.

    Raises:
        SprintlabError: a file is missing or damaged, or the disk refuses.
    """
    check_writable_file(out)
    check_writable(figures / "benches-torque.png")
    parts = splits(data)
    numbers = study(data, parts)
    named = {split.name: split for split in parts}
    torque_figure(figures / "benches-torque.png", data, [named[name] for name in SHOWN])
    heat_figure(figures / "benches-heat.png", data)
    atomic_write_json(out, rounded(numbers))
    print(f"{len(numbers['predictions'])} predictions in {out}")
    return 0


def rounded(value: Any) -> Any:
    """Numbers with six digits: what differs between machines lies below."""
    if isinstance(value, float):
        return float(f"{value:.6g}")
    if isinstance(value, dict):
        return {key: rounded(entry) for key, entry in value.items()}
    return [rounded(entry) for entry in value] if isinstance(value, list) else value


if __name__ == "__main__":
    sys.exit(main())
