"""Trials side by side on the cores: each worker process loads the policy once and runs whole trials."""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path
from types import TracebackType

from sprintlab.control import Policy, check_contract, load_policy
from sprintlab.core.checks import check_range
from sprintlab.core.errors import SimulationError
from sprintlab.evaluation.results import SprintResult, TrialResult
from sprintlab.evaluation.trial import TrialRequest, run_sprint, run_trial
from sprintlab.robots import RobotDescription

_worker: dict[str, object] = {}


class TrialPool:
    """Runs trials of one policy on one robot; use it as a context manager.

    Args:
        policy: path of the policy file.
        robot: the robot it drives.
        workers: processes; ``None`` takes one a core, 1 runs everything in the calling process.

    Raises:
        PolicyFileError: the file is no policy.
        ContractMismatchError: the policy was made for another robot.
        InvalidValueError: ``workers`` is not positive.
    """

    def __init__(self, policy: str | Path, robot: RobotDescription, workers: int | None = None) -> None:
        count = available_cores() if workers is None else workers
        check_range("workers", count, 1, 1024)
        self.policy = load_policy(policy)
        check_contract(self.policy.contract, robot)
        self.robot = robot
        self._executor = _start_workers(Path(policy), robot, count) if count > 1 else None

    def __enter__(self) -> TrialPool:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._executor is not None:
            self._executor.shutdown(wait=True, cancel_futures=True)

    def trials(self, requests: Sequence[TrialRequest]) -> list[TrialResult]:
        """Run profiles, in order of the requests. Raises ``SimulationError`` as ``run_trial`` does."""
        return [result.trial if isinstance(result, SprintResult) else result for result in self.run(requests)]

    def run(self, requests: Sequence[TrialRequest]) -> list[TrialResult | SprintResult]:
        """Run profiles and sprints (those with a distance), results in the order of the requests.

        Raises:
            SimulationError: a trial left the realm of finite numbers, or a worker process died.
        """
        if self._executor is None:
            return [run_request(self.policy, self.robot, request) for request in requests]
        futures = [self._executor.submit(_run_in_worker, request) for request in requests]
        try:
            return [future.result() for future in futures]
        except BrokenProcessPool as error:
            raise SimulationError("a worker process died; is there enough memory?") from error
        finally:
            _cancel(futures)


def available_cores() -> int:
    """Cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def run_request(policy: Policy, robot: RobotDescription, request: TrialRequest) -> TrialResult | SprintResult:
    """A sprint if the request has a distance, else a profile; errors as in ``run_trial``."""
    run = run_trial if request.distance is None else run_sprint
    return run(policy, robot, request)


def _start_workers(policy: Path, robot: RobotDescription, count: int) -> ProcessPoolExecutor:
    """Fresh interpreters: a fork would copy locks of libraries that run threads."""
    context = multiprocessing.get_context("spawn")
    return ProcessPoolExecutor(count, context, initializer=_load_worker, initargs=(policy, robot))


def _load_worker(policy: Path, robot: RobotDescription) -> None:
    _worker.update(policy=load_policy(policy), robot=robot)


def _run_in_worker(request: TrialRequest) -> TrialResult | SprintResult:
    policy, robot = _worker["policy"], _worker["robot"]
    assert isinstance(policy, Policy) and isinstance(robot, RobotDescription)
    return run_request(policy, robot, request)


def _cancel(futures: Sequence[Future]) -> None:
    """Drop what has not started; nothing to do when all have ended."""
    for future in futures:
        future.cancel()
