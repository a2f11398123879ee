"""``python -m studies.mjlab_speed``: train, judge, page."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

import studies.mjlab_speed
from studies.mjlab_speed.train import ACTUATORS, ITERATIONS, run_all, train


def parser() -> argparse.ArgumentParser:
    """The command line."""
    whole = argparse.ArgumentParser(
        description=studies.mjlab_speed.__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    commands = whole.add_subparsers(dest="command", required=True)
    for name in ("train", "one"):
        part = commands.add_parser(name)
        part.add_argument("--iterations", type=int, default=ITERATIONS)
        part.add_argument("--environments", type=int, default=2048)
        if name == "one":
            part.add_argument("--folder", type=Path)
            part.add_argument("--actuator", choices=ACTUATORS)
            part.add_argument("--seed", type=int)
            part.add_argument("--until", type=float)
            continue
        part.add_argument("--work", type=Path, default=Path("/tmp/mjlab-speed"), help="checkpoints are here")
        part.add_argument("--output", type=Path, required=True)
        part.add_argument("--actuators", nargs="+", choices=ACTUATORS, default=ACTUATORS)
        part.add_argument("--seeds", type=int, nargs="+", default=(1, 2, 3))
        part.add_argument(
            "--minutes", type=float, default=9.0, help="after this, trainings stop at a checkpoint"
        )
        part.add_argument("--parallel", type=int, default=3, help="trainings at a time on each GPU")
    part = commands.add_parser("judge")
    part.add_argument("results", type=Path, help="folder of runs; judged ones are left alone")
    part.add_argument("--jobs", type=int, default=2, help="judgements at a time")
    part = commands.add_parser("page")
    part.add_argument("results", type=Path)
    part.add_argument("docs", type=Path)
    return whole


def main(words: Sequence[str] | None = None) -> None:
    """Read the command line and work."""
    given = parser().parse_args(words)
    if given.command == "train":
        run_all(given)
    elif given.command == "one":
        train(given.actuator, given.seed, given.folder, given.iterations, given.environments, given.until)
    elif given.command == "judge":
        from studies.mjlab_speed.judge import judge_all

        judge_all(given.results, given.jobs)
    else:
        from studies.mjlab_speed.page import page

        page(given.results, given.docs)


if __name__ == "__main__":
    main()
