"""Trainings as processes of their own: one after the other on each GPU, resumed where they stopped."""

from __future__ import annotations

import queue
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass
from pathlib import Path

from sprintlab.api.results import Progress, remark
from sprintlab.core.errors import SprintlabError

LONGEST_STOP = 60.0
"""For which a training that is stopped may save and end [s]."""


@dataclass(frozen=True, kw_only=True)
class Job:
    """One training as a process of its own.

    Attributes:
        words: of ``sprintlab train``, without device, output and resume.
        folder: of the run; a policy in it means that it is finished.
    """

    words: tuple[str, ...]
    folder: Path

    @property
    def finished(self) -> bool:
        """Whether the training ran to its end and was exported."""
        return (self.folder / "policy.onnx").is_file()

    @property
    def begun(self) -> bool:
        """Whether there is a checkpoint from which it goes on."""
        return (self.folder / "checkpoint.pt").is_file()

    def command(self, device: str) -> list[str]:
        """Start, or go on."""
        again = ["--resume"] if self.begun else []
        given = ["--device", device, "--output", str(self.folder), *again]
        return [sys.executable, "-m", "sprintlab", "train", *self.words, *given]

    def run(self, device: str, seconds: float | None = None) -> bool:
        """Train until it is finished or the time is over; returns whether it is finished.

        The process has its own log, train.log. One that runs out of time saves and goes on next time.

        Raises:
            SprintlabError: it ends with an error.
        """
        self.folder.mkdir(parents=True, exist_ok=True)
        with open(self.folder / "train.log", "ab") as log:
            process = subprocess.Popen(self.command(device), stdout=log, stderr=subprocess.STDOUT)
        try:
            status = process.wait(seconds)
        except subprocess.TimeoutExpired:
            process.send_signal(signal.SIGTERM)
            _wait_or_kill(process)
            return self.finished
        if status or not self.finished:
            raise SprintlabError(f"a training failed, status {status}: see {self.folder / 'train.log'}")
        return True


def _wait_or_kill(process: subprocess.Popen[bytes]) -> None:
    try:
        process.wait(LONGEST_STOP)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


def run_jobs(jobs: Sequence[Job], devices: Sequence[str], until: float, progress: Progress) -> int:
    """Work down a list of trainings, one at a time on each of the devices.

    A training that fails is told and does not stop the others.

    Args:
        jobs: the list; what is finished is left alone.
        devices: the same name several times: that many side by side on it.
        until: time of the monotonic clock at which all stop and save [s].
        progress: called with how many are finished and the share of them.

    Returns:
        How many are finished now.
    """
    free: queue.SimpleQueue[str] = queue.SimpleQueue()
    for device in devices:
        free.put(device)

    def work(job: Job) -> bool:
        device = free.get()
        try:
            left = until - time.monotonic()
            return left > 0.0 and job.run(device, None if left == float("inf") else left)
        finally:
            free.put(device)

    done = sum(job.finished for job in jobs)
    with ThreadPoolExecutor(len(devices)) as threads:
        running = [threads.submit(work, job) for job in jobs if not job.finished]
        try:
            for future in as_completed(running):
                try:
                    done += future.result()
                except SprintlabError as error:
                    remark(str(error))
                progress(f"{done} of {len(jobs)} trainings finished", done / max(len(jobs), 1))
        finally:
            threads.shutdown(wait=False, cancel_futures=True)  # Ctrl-C: what waits does not start
    return done
