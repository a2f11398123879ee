"""What a training shows while it runs: its table or a line every ten seconds, and curves for TensorBoard."""

from __future__ import annotations

import hashlib
import time
from collections.abc import Generator
from contextlib import contextmanager, nullcontext, suppress
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.live import Live

from sprintlab.core.array_types import FloatArray
from sprintlab.core.errors import UnwrittenError
from sprintlab.training.runs.clip import Clips
from sprintlab.training.runs.screen import clock, plain_exam, plain_line, screen

PRINT_SECONDS = 10.0
LIVE_SECONDS = 0.25
"""Least time between two updates of the table on a terminal; drawing it takes a millisecond or two."""
BOARD_SECONDS = 1.0
"""Least time between two points in TensorBoard: the log has every iteration, and curves need no more."""
CLIP_SECONDS = 10.0
"""How long a training waits for its last clip [s]."""
EXAM = "exam/held"
"""A number that only rows of iterations with an exam have."""
_CONTEXT = ("iteration", "seconds", "environment_steps")


class Board:
    """Curves, at most one point a second, and clips of exams for TensorBoard in the folder of a run.

    Args:
        iteration: Iteration that was reached: later points of a session that was killed are hidden.
    """

    def __init__(self, folder: Path, robot: str, iteration: int) -> None:
        from torch.utils.tensorboard import SummaryWriter  # takes a second

        place = str(folder / "tensorboard")
        self._writer = SummaryWriter(place, purge_step=iteration + 1 if iteration else None)
        self._last, self._clips = float("-inf"), Clips(folder, robot)

    def add(self, row: dict[str, float], path: FloatArray | None = None) -> None:
        """A point on every curve, unless the last is less than a second old and there was no exam.

        Args:
            row: The iteration, as the log has it.
            path: Generalized positions of a robot in the latest exam ``(steps, nq)``, which become a clip.
        """
        self._add_clip(self._clips.finished())
        if path is not None and EXAM in row:
            self._clips.begin(path, int(row["iteration"]))
        now = time.monotonic()
        if now - self._last < BOARD_SECONDS and EXAM not in row:
            return
        self._last = now
        try:
            for name, value in row.items():
                if name not in _CONTEXT:
                    tag = name if "/" in name else f"run/{name}"
                    self._writer.add_scalar(tag, value, int(row["iteration"]))
        except OSError as error:
            reason = error.strerror or error
            raise UnwrittenError(f"cannot write TensorBoard's curves: {reason}") from error

    def _add_clip(self, clip: Path | None) -> None:
        """A moving picture, of the iteration that its file is named after."""
        if clip is None:
            return
        from tensorboard.compat.proto.summary_pb2 import Summary

        image = Summary.Image(colorspace=3, encoded_image_string=clip.read_bytes())
        summary = Summary(value=[Summary.Value(tag="exam/clip", image=image)])
        self._writer._get_file_writer().add_summary(summary, int(clip.stem))

    def close(self, wait: float = 0.0) -> None:
        """Write out what is buffered, after a wait [s] for the clip that is being rendered.

        A disk that refuses curves hides no other message.
        """
        with suppress(OSError):
            self._add_clip(self._clips.finished(wait))
            self._clips.close()
            self._writer.close()


def follow_on_wandb(project: str, folder: Path, settings: dict[str, Any]) -> None:
    """Send what TensorBoard gets to Weights & Biases, too; must be called before the board is made.

    Args:
        folder: Folder of the run; its name becomes the run's, and a resumed run goes on there.
    """
    import wandb

    name = "-".join(folder.absolute().parts[1:][-3:])
    wandb.init(
        project=project,
        dir=str(folder),
        name=name,
        id=hashlib.sha256(name.encode()).hexdigest()[:16],
        resume="allow",
        config=settings,
        sync_tensorboard=True,
    )


@contextmanager
def preparing(quiet: bool) -> Generator[None]:
    """Say on stderr that kernels are being compiled."""
    console = Console(stderr=True, highlight=False, quiet=quiet)
    text = "preparing: kernels are compiled, once per machine (up to two minutes)"
    began = time.monotonic()
    with console.status(text) if console.is_terminal else nullcontext(console.print(text, soft_wrap=True)):
        yield
    console.print(f"prepared in {time.monotonic() - began:.1f} s")


class Reporter:
    """Progress on stderr: a table on a terminal, else a line every ten seconds.

    Args:
        rolled_back: Updates taken back before this session.
        quiet: Print nothing: for the processes that do not lead.
    """

    def __init__(
        self, title: str, share: float, board: Board | None, rolled_back: float = 0.0, quiet: bool = False
    ) -> None:
        self._title, self._first, self._exam = title, share, dict[str, float]()
        self._board, self._rolled_back, self._broken = board, rolled_back, False
        self._console = Console(stderr=True, highlight=False, quiet=quiet)
        self._live = self._console.is_terminal and not quiet
        self._display = Live(console=self._console, auto_refresh=False)
        self._began = time.monotonic()
        self._printed = float("-inf")

    def __enter__(self) -> Reporter:
        if self._live:
            self._display.start()
        return self

    def __exit__(self, error: type[BaseException] | None, *_: object) -> None:
        self._display.stop()
        if self._board is not None:
            self._board.close(CLIP_SECONDS if error is None else 0.0)

    def say(self, text: str) -> None:
        """A remark on a line of its own."""
        self._console.print(text, soft_wrap=True, markup=False)

    def show(self, row: dict[str, float], share: float, path: FloatArray | None = None) -> None:
        """One iteration has been done, and so much of the run; ``path`` as for ``Board.add``."""
        if self._board is not None:
            self._board.add(row, path)
        self._warn(row)
        if EXAM in row:
            self._exam = {name: row[name] for name in row if name.startswith("exam/")}
            self._exam["iteration"] = row["iteration"]
            if not self._live:
                self.say(plain_exam(row))
        now = time.monotonic()
        pause = LIVE_SECONDS if self._live else PRINT_SECONDS
        if now - self._printed > pause or row["iteration"] <= 1 or EXAM in row:
            self._printed = now
            self._print(row, share, now - self._began)

    def _print(self, row: dict[str, float], share: float, elapsed: float) -> None:
        left = elapsed * (1.0 - share) / max(share - self._first, 1e-9)
        if self._live:
            shown = screen(self._title, row, self._exam, share, left, self._console.height)
            self._display.update(shown, refresh=True)
        else:
            self.say(f"{plain_line(row)}, {clock(left)} left")

    def _warn(self, row: dict[str, float]) -> None:
        if row["rolled_back"] > self._rolled_back:
            self._rolled_back = row["rolled_back"]
            self.say(
                f"warning: update {row['iteration']:.0f} diverged and was taken back "
                f"({self._rolled_back:.0f} so far)"
            )
        if row["broken"] and not self._broken:
            self._broken = True
            self.say(
                f"warning: iteration {row['iteration']:.0f} had {row['broken']:.0f} robots with broken "
                "physics (NaN or impossible speeds); they were reset and are counted as 'broken'"
            )
