"""One lap of a standard track in lane 1: time, lane, energy, heat."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from sprintlab.commands import KERB_DISTANCE, LANE_WIDTH, SprintProfile, Track, along_track, path_yaw_rate
from sprintlab.control import Policy
from sprintlab.core.checks import check_range
from sprintlab.core.json_values import json_ready
from sprintlab.evaluation.metrics import bus_power
from sprintlab.evaluation.results import TrialResult
from sprintlab.evaluation.trial import SprintCourse, TrialRequest, run_course
from sprintlab.plant import BaseState
from sprintlab.robots import RobotDescription


@dataclass(frozen=True, kw_only=True)
class LapResult:
    """One lap."""

    distance: float  # length of the lap on the measured line [m]
    time: float  # from the first non-zero command to the end of the lap [s]; nan when it was not reached
    outward: float  # farthest from the measured line, away from the kerb [m]
    inward: float  # farthest from the measured line, towards the kerb [m]
    energy: float  # drawn from the bus until the end of the lap [J]
    hottest_winding: float | None  # [degC]; None where windings do not warm up
    trial: TrialResult  # its hold is the whole run

    @property
    def finished(self) -> bool:
        """Whether the lap was run to its end."""
        return math.isfinite(self.time)

    @property
    def lane_kept(self) -> bool:
        """Whether the trunk's centre stayed within lane 1: its kerb inside, the next lane's line outside."""
        return self.inward <= KERB_DISTANCE and self.outward <= LANE_WIDTH - KERB_DISTANCE

    def to_dict(self) -> dict[str, Any]:
        """JSON-ready numbers; what is not defined becomes null."""
        return json_ready(
            {
                "distance_m": self.distance,
                "time_s": self.time,
                "finished": self.finished,
                "lane_kept": self.lane_kept,
                "farthest_outward_m": self.outward,
                "farthest_inward_m": self.inward,
                "energy_J": self.energy,
                "hottest_winding_degC": self.hottest_winding,
                "fall_reason": self.trial.fall_reason,
                "top_speed_command_m_s": self.trial.top_speed,
                "self_paced": self.trial.self_paced,
            }
        )


class LapCourse(SprintCourse):
    """Rise and hold until the lap is run, then brake and stand for a second; follows the track.

    The distance counts along the track, so cutting a bend gains what it gains in a race: nothing beyond the
    shorter way.
    """

    def __init__(self, track: Track, top_speed: float) -> None:
        profile = SprintProfile(top_speed=top_speed)
        super().__init__(profile, track.length, rest=profile.stand, slowest_share=0.5)
        self.track = track
        self._last, self._run = 0.0, 0.0

    def run_distance(self, base: BaseState) -> float:
        """Along the track [m]; it goes on counting over the start line."""
        now, length = self.track.locate(base.distance, base.lateral_offset).progress, self.track.length
        self._run += (now - self._last + 0.5 * length) % length - 0.5 * length
        self._last = now
        return self._run

    def steer(self, base: BaseState, speed: float) -> float:
        """Yaw-rate command [rad/s] along the track."""
        point = self.track.locate(base.distance, base.lateral_offset)
        return path_yaw_rate(point, base.heading, speed)


def run_lap(policy: Policy, robot: RobotDescription, request: TrialRequest) -> LapResult:
    """Run one lap with the request's command; errors as in ``run_trial``.

    Raises:
        InvalidValueError: the command is below 1 m/s: the lap would take minutes of simulation.
    """
    check_range("lap.top_speed", request.top_speed, 1.0, 30.0, "m/s")
    course = LapCourse(Track(), request.top_speed)
    return lap_result(run_course(policy, robot, request, course), robot, course.track)


def lap_result(trial: TrialResult, robot: RobotDescription, track: Track) -> LapResult:
    """The lap's numbers from a recorded run."""
    recorded = trial.trajectory
    assert recorded is not None
    progress, offset = along_track(track, recorded.qpos)
    done = progress >= track.length
    last = int(done.argmax()) if done.any() else len(done) - 1
    start = float(recorded.time[int((recorded.profile_speed > 0.0).argmax())])
    duration = float(recorded.time[last] - recorded.time[0])
    return LapResult(
        distance=track.length,
        time=float(recorded.time[last]) - start if done.any() else math.nan,
        outward=float(np.max(-offset[: last + 1])),
        inward=float(np.max(offset[: last + 1])),
        energy=float(bus_power(recorded, robot)[: last + 1].mean()) * duration,
        hottest_winding=trial.metrics.hottest_winding,
        trial=trial,
    )
