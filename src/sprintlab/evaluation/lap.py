"""One lap of a standard track in lane 1: time, lane, energy, heat."""

from __future__ import annotations

import math
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


def run_lap(
    policy: Policy, robot: RobotDescription, request: TrialRequest
) -> tuple[TrialResult, dict[str, Any]]:
    """Run one lap with the request's command: the trial, whose hold is the whole run, and ``lap_numbers``.

    Raises:
        InvalidValueError: the command is below 1 m/s: the lap would take minutes of simulation.
        SimulationError, ContractMismatchError: as in ``run_trial``.
    """
    check_range("lap.top_speed", request.top_speed, 1.0, 30.0, "m/s")
    course = LapCourse(Track(), request.top_speed)
    trial = run_course(policy, robot, request, course)
    return trial, lap_numbers(trial, robot, course.track)


def lap_numbers(trial: TrialResult, robot: RobotDescription, track: Track) -> dict[str, Any]:
    """JSON-ready numbers of a recorded lap; what is not defined becomes null.

    The time counts from the first non-zero command, the energy from the start, both to the end of the lap.
    The lane is kept where the trunk's centre stays between its kerb and the next lane's line.
    """
    recorded = trial.trajectory
    assert recorded is not None
    progress, offset = along_track(track, recorded.qpos)
    done = progress >= track.length
    last = int(done.argmax()) if done.any() else len(done) - 1
    start = float(recorded.time[int((recorded.profile_speed > 0.0).argmax())])
    duration = float(recorded.time[last] - recorded.time[0])
    outward, inward = float(np.max(-offset[: last + 1])), float(np.max(offset[: last + 1]))
    return json_ready(
        {
            "distance_m": track.length,
            "time_s": float(recorded.time[last]) - start if done.any() else math.nan,
            "finished": bool(done.any()),
            "lane_kept": inward <= KERB_DISTANCE and outward <= LANE_WIDTH - KERB_DISTANCE,
            "farthest_outward_m": outward,
            "farthest_inward_m": inward,
            "energy_J": float(bus_power(recorded, robot)[: last + 1].mean()) * duration,
            "hottest_winding_degC": trial.metrics.hottest_winding,
            "fall_reason": trial.fall_reason,
            "top_speed_command_m_s": trial.top_speed,
            "self_paced": trial.self_paced,
        }
    )
