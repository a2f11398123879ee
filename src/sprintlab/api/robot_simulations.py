"""``RobotSimulation``: a simulated robot on the robot bus, to be driven by ``RobotRun``."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from math import ceil
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import RenderableType

from sprintlab.api.policies import RobotChoice, default_robot
from sprintlab.api.processes import Progress
from sprintlab.api.tables import Printed, plain_table
from sprintlab.core.arguments import check_kind, checked
from sprintlab.core.checks import check_choice, check_positive, check_range
from sprintlab.core.errors import InvalidValueError
from sprintlab.core.files import check_writable_file

if TYPE_CHECKING:
    from sprintlab.deployment.simulator import PaceOptions, SimulatorOptions, SimulatorReport
    from sprintlab.evaluation.recorder import Recorder

_LONGEST_TRUTH = 3600.0  # s, for whose samples there must be memory from the start


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class SimulatedRun(Printed):
    """What happened to a simulated robot."""

    report: SimulatorReport
    """Times, distance, speed, fall, messages."""

    def to_dict(self) -> dict[str, Any]:
        """The report, SI units."""
        return self.report.to_dict()

    def tables(self) -> Iterator[RenderableType]:
        """One row per number."""
        yield plain_table("Simulated robot", "quantity", "value", "unit", rows=_rows(self.report))


class RobotSimulation:
    """A robot on the bus while a ``with`` block lasts: the 1 kHz plant, with the faults of a real link.

    Args:
        bus: address of the robot: shm://NAME or unitree://NAME[@INTERFACE].
        robot: name, folder or table; that of the policy sprint when left out.
        options: plant, link, noise and start; the nominal robot's when left out.
        pace: real time or lock-step, and when to end.
        distance: mark whose passing is timed [m].
        truth: file (.npz) for the true motion; ``pace`` must have a duration, of an hour at most.
        priority: priority under the real-time scheduler, 1 to 99.
        real_time: use that scheduler, where permitted; never in lock-step.

    Raises:
        SprintlabError: an option or the bus is refused.
    """

    @checked
    def __init__(
        self,
        bus: str = "shm://bp2",
        *,
        robot: RobotChoice = None,
        options: SimulatorOptions | None = None,
        pace: PaceOptions | None = None,
        distance: float = 100.0,
        truth: Path | None = None,
        priority: int = 40,
        real_time: bool = True,
    ) -> None:
        from sprintlab.deployment.bus import open_endpoint
        from sprintlab.deployment.simulator import PaceOptions, SimulatedWorld, SimulatorOptions
        from sprintlab.robots import load_robot

        check_kind("options", options, SimulatorOptions | None)
        check_kind("pace", pace, PaceOptions | None)
        self.pace = pace or PaceOptions()
        check_positive("distance", distance, "m")
        check_range("priority", priority, 1, 99)
        if truth is not None and self.pace.duration is None:
            raise InvalidValueError("truth", str(truth), "give --duration too: it bounds what is kept")
        if truth is not None:
            check_range("duration of a truth", self.pace.duration, 0.0, _LONGEST_TRUTH, "s")
            check_choice("truth's ending", Path(truth).suffix, (".npz",))
            check_writable_file(truth)
        self._distance, self._truth = distance, truth
        self._priority = priority if real_time and not self.pace.lock_step else None
        self._endpoint = open_endpoint(bus)
        try:
            self._world = SimulatedWorld(load_robot(robot or default_robot()), options or SimulatorOptions())
        except BaseException:
            self._endpoint.close()
            raise

    def __enter__(self) -> RobotSimulation:
        return self

    def __exit__(self, *_: object) -> None:
        self._endpoint.close()

    def run(
        self,
        stopped: Callable[[], bool] = lambda: False,
        progress: Progress = lambda what, share: None,
        remark: Callable[[str], None] = lambda text: None,
    ) -> SimulatedRun:
        """Simulate until the end that ``pace`` sets, or until told to stop.

        Args:
            stopped: asked at every step.
            progress: told simulated time and distance.
            remark: told once of each reason for which commands are dropped.

        Raises:
            SprintlabError: the controller stopped answering in lock-step, or the motion cannot be written.
        """
        from sprintlab.deployment.simulator import run_simulator

        recorder = None if self._truth is None else self._recorder()
        with self._scheduler():
            report = run_simulator(
                self._world,
                self._endpoint,
                self.pace,
                marks=(self._distance,),
                recorder=recorder,
                stopped=stopped,
                progress=lambda time, distance: progress(f"{time:.1f} s, {distance:.1f} m", None),
                remark=remark,
            )
        if recorder is not None and self._truth is not None:
            from sprintlab.evaluation.race_files import save_trajectory

            save_trajectory(self._truth, recorder.trajectory())
        return SimulatedRun(report=report)

    def _scheduler(self) -> AbstractContextManager[Any]:
        """Real-time scheduling, unless the clock does not matter."""
        from sprintlab.deployment.controller.realtime import real_time

        return nullcontext() if self._priority is None else real_time(self._priority)

    def _recorder(self) -> Recorder:
        """Records the true motion for as long as the simulation lasts at most."""
        from sprintlab.evaluation.recorder import Recorder

        assert self.pace.duration is not None
        plant = self._world.robot.plant
        return Recorder(plant, ceil(self.pace.duration * plant.options.record_rate) + 1)


def _rows(report: SimulatorReport) -> list[tuple[str, str, str]]:
    marks = [(f"passed {mark:g} m at", f"{moment:.2f}", "s") for mark, moment in report.finish_times.items()]
    return [
        ("simulated time", f"{report.simulated_time:.2f}", "s"),
        ("greatest distance", f"{report.greatest_distance:.2f}", "m"),
        *marks,
        ("top speed (0.5 s mean)", f"{report.top_speed:.2f}", "m/s"),
        ("fall", report.fall_reason or "none", ""),
        ("commands accepted", str(report.commands_accepted), ""),
        ("commands dropped", str(report.commands_dropped), ""),
        *((f"dropped: {reason}", str(count), "") for reason, count in report.drop_reasons.items()),
        ("watchdog trips", str(report.watchdog_trips), ""),
        ("late steps", str(report.late_steps), ""),
        ("time given up", f"{1e3 * report.given_up:.1f}", "ms"),
    ]
