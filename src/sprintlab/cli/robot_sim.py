"""``sprintlab robot-sim``: a simulated robot on the robot bus, to drive with ``sprintlab run``."""

from __future__ import annotations

from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import tyro

from sprintlab.api.drive import DriveOptions
from sprintlab.api.policies import default_robot
from sprintlab.cli.interruptions import counted_interruptions
from sprintlab.cli.output import plain_table, print_json, progress_bar, stderr_console, stdout_console

if TYPE_CHECKING:
    from sprintlab.deployment.simulator import PaceOptions, SimulatorOptions, SimulatorReport


@tyro.conf.configure(tyro.conf.FlagCreatePairsOff)
@dataclass(frozen=True, kw_only=True)
class RobotSim(DriveOptions):
    """Be a robot on the bus: the 1 kHz plant in a process of its own, with the faults of a real link.

    It runs until Ctrl-C, until --duration has passed, or, with --end-with-controller, until the controller
    has left.

    Attributes:
        bus: address of the robot: shm://NAME, zenoh://NAME[@HOST:PORT] or unitree://NAME[@INTERFACE].
        bus_config: for zenoh on a network: how both ends recognize each other, a file in zenoh's format with
            TLS, or user and password.
        robot: a robot's name, or a parameter table of one's own (.toml); the policy sprint's when left
            out.
        start: lying on the ground with damped joints, or standing.
        delay: of every message, each way [ms].
        jitter: greatest additional delay of a message, each way [ms].
        loss: share of messages lost, each way [%].
        noise: sensor noise, as a multiple of a typical set.
        bus_voltage: of a stiff bus [V]; the robot's own when left out. --battery makes it sag.
        friction: of feet and floor.
        payload: mass added to the trunk [kg].
        watchdog: without a command for this long, the robot damps its joints by itself [ms].
        fix_rate: position fixes a second, as from an RTK receiver [Hz]; 0 for none.
        seed: decides noise, jitter and losses.
        priority: of the real-time scheduler, 1 to 99, where permitted; below the controller's.
        no_real_time: keep the normal scheduler.
        speed_factor: simulated seconds per second; 1 is real time.
        lock_step: one step for each answer of the controller, whatever the clock says.
        duration: end after this much simulated time [s].
        end_with_controller: end when the controller has left.
        distance: mark whose passing is timed [m].
        truth: also write the true motion as a trajectory (.npz); needs --duration.
        json: print JSON only.
    """

    bus: tyro.conf.Positional[str] = "shm://bp2"
    bus_config: Path | None = None
    robot: str | None = None
    start: str = "lying"
    delay: float = 0.0
    jitter: float = 0.0
    loss: float = 0.0
    noise: float = 0.0
    bus_voltage: float | None = None
    friction: float = 0.85
    payload: float = 0.0
    watchdog: float = 50.0
    fix_rate: float = 10.0
    seed: int = 0
    priority: int = 40
    no_real_time: bool = False
    speed_factor: float = 1.0
    lock_step: bool = False
    duration: float | None = None
    end_with_controller: bool = False
    distance: float = 100.0
    truth: Path | None = None
    json: bool = False

    def run(self) -> int:
        """Simulate until the end; 1 when the robot fell.

        Raises:
            SprintlabError: an option or the bus is refused, or the controller stopped answering.
        """
        from sprintlab.core.checks import check_positive
        from sprintlab.core.errors import InvalidValueError
        from sprintlab.deployment.bus import open_endpoint
        from sprintlab.deployment.simulator import SimulatedWorld
        from sprintlab.robots import load_robot

        check_positive("distance", self.distance, "m")
        if self.truth is not None and self.duration is None:
            raise InvalidValueError("truth", str(self.truth), "give --duration too: it bounds what is kept")
        pace, options = self._pace(), self._options()
        endpoint = open_endpoint(self.bus, config=self.bus_config)
        try:
            world = SimulatedWorld(load_robot(self.robot or default_robot()), options)
            report = self._simulate(world, endpoint, pace)
        finally:
            endpoint.close()
        self._show(report)
        return 1 if report.fall_reason else 0

    def _simulate(self, world: Any, endpoint: Any, pace: PaceOptions) -> SimulatorReport:
        from sprintlab.deployment.simulator import run_simulator

        stderr_console().print(f"the robot is on {self.bus}; Ctrl-C ends it", soft_wrap=True)
        recorder = None if self.truth is None else self._recorder(world)
        with (
            progress_bar(quiet=self.json) as report,
            counted_interruptions() as interrupted,
            self._scheduler(),
        ):
            result = run_simulator(
                world,
                endpoint,
                pace,
                marks=(self.distance,),
                recorder=recorder,
                stopped=lambda: interrupted() > 0,
                progress=lambda time, distance: report(f"{time:.1f} s, {distance:.1f} m", None),
            )
        if recorder is not None and self.truth is not None:
            from sprintlab.evaluation.race_files import save_trajectory

            save_trajectory(self.truth, recorder.trajectory())
        return result

    def _scheduler(self) -> AbstractContextManager[Any]:
        """Real-time scheduling, unless the clock does not matter."""
        from sprintlab.core.checks import check_range
        from sprintlab.deployment.controller.realtime import real_time

        check_range("priority", self.priority, 1, 99)
        return nullcontext() if self.lock_step or self.no_real_time else real_time(self.priority)

    def _recorder(self, world: Any) -> Any:
        """Records the true motion for as long as --duration says."""
        from math import ceil

        from sprintlab.evaluation.recorder import Recorder

        assert self.duration is not None
        plant = world.robot.plant
        return Recorder(plant.model, plant.robot, ceil(self.duration * plant.options.record_rate) + 1)

    def _options(self) -> SimulatorOptions:
        from sprintlab.deployment.simulator import LinkOptions, SensorNoise, SimulatorOptions
        from sprintlab.deployment.simulator.options import TYPICAL_NOISE
        from sprintlab.plant import TrialSettings

        link = LinkOptions(delay=1e-3 * self.delay, jitter=1e-3 * self.jitter, loss=0.01 * self.loss)
        noise: SensorNoise = TYPICAL_NOISE.scaled(self.noise)
        return SimulatorOptions(
            plant=replace(self.plant(), bus_voltage=self.bus_voltage),
            trial=TrialSettings(seed=self.seed, friction=self.friction, payload=self.payload),
            to_controller=link,
            to_robot=link,
            noise=noise,
            start=self.start,
            fix_rate=self.fix_rate,
            watchdog_timeout=1e-3 * self.watchdog,
            seed=self.seed,
        )

    def _pace(self) -> PaceOptions:
        from sprintlab.deployment.simulator import PaceOptions

        return PaceOptions(
            speed_factor=self.speed_factor,
            lock_step=self.lock_step,
            duration=self.duration,
            end_with_controller=self.end_with_controller,
        )

    def _show(self, report: SimulatorReport) -> None:
        if self.json:
            print_json(report.to_dict())
            return
        table = plain_table("Simulated robot", "quantity", "value", "unit", numbers=("value",))
        for name, value, unit in _rows(report):
            table.add_row(name, value, unit)
        stdout_console().print(table)


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
        ("watchdog trips", str(report.watchdog_trips), ""),
        ("late steps", str(report.late_steps), ""),
        ("time given up", f"{1e3 * report.given_up:.1f}", "ms"),
    ]
