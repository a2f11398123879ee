"""``python -m studies.paper stride``: the strides of the trajectory prior, found before any training."""

from __future__ import annotations

import io
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import tyro

from sprintlab.cli.output import print_json, progress_bar
from sprintlab.core.checks import check_positive

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from sprintlab.speed_limit import Runner

    FloatArray = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Strides:
    """Find one possible stride of a robot's leg at each of several speeds, and write them as a reference.

    Attributes:
        robot: a robot's name or folder.
        output: file of the strides.
        speeds: of the trunk [m/s].
        starts: random strides from which each search begins.
        max_stride: highest stride frequency [Hz].
        min_duty: lowest share of a stride in which a foot is on the ground.
        json: print JSON only.
    """

    robot: str = "bp2"
    output: Path = Path("studies/paper/strides.npz")
    speeds: tuple[float, ...] = (4.0, 6.0, 8.0, 10.0, 12.0)
    starts: int = 2
    max_stride: float = 5.5
    min_duty: float = 0.12
    json: tyro.conf.FlagCreatePairsOff[bool] = False

    def run(self) -> int:
        """Search, write, print.

        Raises:
            SprintlabError: the robot or a number is refused, no stride is possible, or the disk refuses.
        """
        from sprintlab.core.files import atomic_write_bytes, check_writable_file
        from sprintlab.robots import load_robot
        from sprintlab.speed_limit import Fastest, SearchSettings, fastest_stride, runner_from_robot

        for speed in self.speeds:
            check_positive("speeds", speed, "m/s")
        settings = SearchSettings(starts=self.starts, max_stride=self.max_stride, min_duty=self.min_duty)
        check_writable_file(self.output)
        runner = runner_from_robot(load_robot(self.robot))
        found: list[Fastest] = []
        with progress_bar(quiet=self.json) as report:
            for number, speed in enumerate(sorted(self.speeds)):
                report(f"stride at {speed:g} m/s", number / len(self.speeds))
                found.append(fastest_stride(runner, settings, near=found[-1:], ceiling=speed))
        reached = np.array([stride.speed for stride in found])
        state = np.stack([drive_states(runner, stride.parameters, stride.speed) for stride in found])
        stream = io.BytesIO()
        np.savez_compressed(stream, speed=reached, state=state.astype(np.float32))
        atomic_write_bytes(self.output, stream.getvalue())
        if self.json:
            print_json({"file": str(self.output), "speeds_m_s": reached.tolist()})
        else:
            print(f"{self.output}: strides at {', '.join(f'{speed:.2f}' for speed in reached)} m/s")
        return 0


def drive_states(runner: Runner, parameters: FloatArray, speed: float) -> FloatArray:
    """Hip and knee of the drives over one stride ``(points, 4)``: angles [rad], then velocities [rad/s].

    The encoder sits on the knee's drive, which leads the knee by what its series spring gives.
    """
    from sprintlab.speed_limit import evaluate

    stride = evaluate(runner, parameters[None], speed)
    position = stride.position[0].copy()
    position[: stride.deflection.shape[1], 1] += stride.deflection[0]
    return np.hstack((position, stride.velocity[0]))
