"""``sprintlab robot-sim``: a simulated robot on the robot bus, to drive with ``sprintlab run``."""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import tyro

from sprintlab.api.drive import DriveOptions
from sprintlab.api.robot_simulations import RobotSimulation
from sprintlab.cli.interruptions import counted_interruptions
from sprintlab.cli.output import progress_bar, show, stderr_console

if TYPE_CHECKING:
    from sprintlab.deployment.simulator import PaceOptions, SimulatorOptions


@dataclass(frozen=True, kw_only=True)
class RobotSim(DriveOptions):
    """Be a robot on the bus: the 1 kHz plant in a process of its own, with the faults of a real link.

    It runs until Ctrl-C, until --duration has passed, or, with --end-with-controller, until the controller
    has left.

    Attributes:
        bus: address of the robot: shm://NAME or unitree://NAME[@INTERFACE].
        robot: a robot's name, or a parameter table of one's own (.toml); the policy sprint's when left
            out.
        start: lying on the ground with damped joints, or standing.
        delay: delay of every message, each way [ms].
        jitter: greatest additional delay of a message, each way [ms].
        loss: share of messages lost, each way [%].
        noise: sensor noise, as a multiple of a typical set.
        bus_voltage: voltage of a stiff bus [V]; the robot's own when left out. --battery makes it sag.
        friction: friction coefficient of feet and floor.
        payload: mass added to the trunk [kg].
        watchdog: without a command for this long, the robot damps its joints by itself [ms].
        fix_rate: position fixes a second, as from an RTK receiver [Hz]; 0 for none.
        seed: decides noise, jitter and losses.
        priority: priority under the real-time scheduler, 1 to 99, where permitted; below the controller's.
        no_real_time: keep the normal scheduler.
        speed_factor: simulated seconds per second; 1 is real time.
        lock_step: one step for each answer of the controller, whatever the clock says.
        duration: end after this much simulated time [s].
        end_with_controller: end when the controller has left.
        distance: mark whose passing is timed [m].
        truth: also write the true motion as a trajectory (.npz); needs --duration,
            of an hour at most.
        json: print JSON only.
    """

    bus: tyro.conf.Positional[str] = "shm://bp2"
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
        with ExitStack() as told:
            with RobotSimulation(
                self.bus,
                robot=self.robot,
                options=self._options(),
                pace=self._pace(),
                distance=self.distance,
                truth=self.truth,
                priority=self.priority,
                real_time=not self.no_real_time,
            ) as robot:
                console = stderr_console()

                def remark(text: str) -> None:
                    console.print(text, soft_wrap=True, markup=False)

                remark(f"the robot is on {self.bus}; Ctrl-C ends it")
                # Until the numbers are told: leaving may take seconds, and Ctrl-C may come again.
                interrupted = told.enter_context(counted_interruptions())
                with progress_bar(quiet=self.json) as report:
                    found = robot.run(lambda: interrupted() > 0, report, remark)
            show(found, self)
        return 1 if found.report.fall_reason else 0

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
