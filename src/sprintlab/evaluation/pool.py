"""Trials side by side on the cores: each worker process loads a policy once and runs whole trials."""

from __future__ import annotations

import multiprocessing
import os
import threading
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import closing
from functools import lru_cache, partial
from multiprocessing import connection
from multiprocessing.synchronize import Event
from pathlib import Path
from typing import Any, TypeVar

from sprintlab.control import Policy, check_contract, load_policy
from sprintlab.core.checks import check_range
from sprintlab.core.errors import PolicyFileError, SimulationError
from sprintlab.core.interpreters import SAFE_PATH
from sprintlab.evaluation.results import SprintResult, TrialResult
from sprintlab.evaluation.trial import TrialRequest, run_sprint, run_trial
from sprintlab.robots import RobotDescription

T = TypeVar("T")
R = TypeVar("R")

NO_GUARD = (
    "no worker process could begin: each reads the script that was started, so what calls sprintlab there "
    'must stand under  if __name__ == "__main__":  (or ask for one worker)'
)
_ENVIRONMENT = (
    "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS", SAFE_PATH
)  # fmt: skip


class WorkerProcesses:
    """New interpreters of one thread each that trials of any policy are sent to; a context manager.

    Args:
        count: processes; ``None`` takes one a core, 1 runs everything in the calling process.

    Raises:
        InvalidValueError: ``count`` is not positive.
    """

    def __init__(self, count: int | None = None) -> None:
        cores = os.sched_getaffinity(0) if hasattr(os, "sched_getaffinity") else range(os.cpu_count() or 1)
        count = len(cores) if count is None else count
        check_range("workers", count, 1, 1024)
        self._before = {name: os.environ.get(name) for name in _ENVIRONMENT}
        self._executor: ProcessPoolExecutor | None = None
        if count > 1:
            # New interpreters inherit them, and read them before anything could tell them otherwise.
            os.environ.update(dict.fromkeys(_ENVIRONMENT, "1"))
            # Spawned: a fork would copy locks of libraries that run threads.
            context = multiprocessing.get_context("spawn")
            self._begun = context.Event()
            self._executor = ProcessPoolExecutor(count, context, initializer=_begin, initargs=(self._begun,))

    def __enter__(self) -> WorkerProcesses:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if self._executor is None:
            return
        if kind is not None and not issubclass(kind, Exception):  # Ctrl-C does not wait for trials to end
            for process in (getattr(self._executor, "_processes", None) or {}).copy().values():
                process.terminate()
        self._executor.shutdown(wait=True, cancel_futures=True)
        for name, value in self._before.items():
            os.environ.pop(name, None)
            os.environ.update({} if value is None else {name: value})

    def map(self, work: Callable[[T], R], items: Sequence[T]) -> Generator[R, None, None]:
        """Results in the order of the items, each as soon as it and those before it are there.

        Closing the iterator drops what has not started.

        Raises:
            SimulationError: a trial left the realm of finite numbers, or a worker process died.
        """
        if self._executor is None:
            yield from map(work, items)
            return
        futures: list[Future] = []
        try:
            futures += [self._executor.submit(work, item) for item in items]
            for future in futures:
                yield future.result()
        except BrokenProcessPool as error:
            message = "a worker process died; is there enough memory?" if self._begun.is_set() else NO_GUARD
            raise SimulationError(message) from error
        finally:
            for future in futures:
                future.cancel()


class TrialPool:
    """Runs simulated runs of one policy on one robot side by side in worker processes; a context manager.

    Args:
        policy: path of the policy file.
        robot: the robot it drives.
        workers: as the ``count`` of ``WorkerProcesses``.
        processes: to use instead of own ones; they stay open.

    Raises:
        PolicyFileError: the file is no policy.
        ContractMismatchError: the policy was made for another robot.
        InvalidValueError: ``workers`` is not positive.
    """

    def __init__(
        self,
        policy: str | Path,
        robot: RobotDescription,
        workers: int | None = None,
        processes: WorkerProcesses | None = None,
    ) -> None:
        self.policy = load_policy(policy)
        self._file = (Path(policy), self.policy.digest)
        check_contract(self.policy.contract, robot)
        self.robot = robot
        self._owned = processes is None
        self._processes = WorkerProcesses(workers) if processes is None else processes

    def __enter__(self) -> TrialPool:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if self._owned:
            self._processes.__exit__(kind)

    def map(
        self, work: Callable[[Policy, RobotDescription, T], R], items: Sequence[T]
    ) -> Generator[R, None, None]:
        """Results of ``work(policy, robot, item)``; order and errors as of ``WorkerProcesses.map``.

        ``work`` is a function of a module, so that it can be sent to another process.
        """
        return self._processes.map(partial(_worked, work, *self._file, self.robot), items)

    def stream(self, requests: Sequence[TrialRequest]) -> Generator[Any, None, None]:
        """A ``SprintResult`` for each request with a distance, else a ``TrialResult``."""
        return self.map(run_request, requests)

    def trials(self, requests: Sequence[TrialRequest], most_falls: int | None = None) -> list[TrialResult]:
        """Run profiles, in order of the requests; errors as those of ``map``.

        Args:
            requests: what to run.
            most_falls: stop after the trial that is one fall more than this; the list then ends with it,
                the same whatever the number of processes.
        """
        results: list[TrialResult] = []
        with closing(self.stream(requests)) as finished:
            for result in finished:
                results.append(result)
                falls = sum(bool(trial.fall_reason) for trial in results)
                if most_falls is not None and falls > most_falls:
                    break
        return results


def run_request(policy: Policy, robot: RobotDescription, request: TrialRequest) -> TrialResult | SprintResult:
    """A sprint if the request has a distance, else a profile; errors as in ``run_trial``."""
    run = run_trial if request.distance is None else run_sprint
    return run(policy, robot, request)


@lru_cache(maxsize=8)
def _loaded(path: Path, digest: str) -> Policy:
    """Read once in each process: reading takes as long as a second of simulation.

    Raises:
        PolicyFileError: the file has changed since the run began, whose numbers would be of two policies.
    """
    loaded = load_policy(path)
    if loaded.digest != digest:
        raise PolicyFileError(f"{path} has changed since the run began: run it again")
    return loaded


def _worked(work: Callable[..., R], path: Path, digest: str, robot: RobotDescription, item: Any) -> R:
    return work(_loaded(path, digest), robot, item)


def _begin(begun: Event) -> None:
    """What a worker does first: say that it could read its parent's script, and end with its parent."""
    begun.set()
    parent = multiprocessing.parent_process()
    assert parent is not None

    def watch() -> None:
        connection.wait([parent.sentinel])
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
