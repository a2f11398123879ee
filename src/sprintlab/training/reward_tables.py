"""Rewards of a run, a line a term: this package's, the paper's Table I, and Hound's.

A table is whole: none begins with another, so that a new line in one changes none of the others.
"""

from __future__ import annotations

from sprintlab.training.environment import rewards
from sprintlab.training.terms import RewardTerm, term

Rewards = dict[str, RewardTerm]


def default_rewards() -> Rewards:
    """The paper's terms, and what makes gaits believable.

    ``action_rate``, ``smoothness`` and ``joint_acceleration`` have the paper's weights in stage I. In stage
    II it has -0.01, -0.005 and -1e-7; these grow with the swing speed and held the speed near 9.4 m/s. It
    drops ``collision`` in stage II; kept, since it prevents crawling. End stops, legs and over-speed are
    constraints here, no rewards.
    """
    return {
        "linear_tracking": term(rewards.linear_tracking, 1.0, tied=True, speed=1.0),
        "angular_tracking": term(rewards.angular_tracking, 0.5, tied=True, sharpness=1.0),
        "progress": term(rewards.progress, 1.5, tied=True, speed=10.0),
        "speed_held": term(rewards.speed_held, 4.0, speed=0.3, share=0.065, brake_lag=0.8),
        "yaw_rate_held": term(rewards.yaw_rate_held, 3.5, tied=True, yaw_rates=(0.1, 0.4)),
        "vertical_velocity": term(rewards.vertical_velocity, -2.0),
        "joint_power": term(rewards.joint_power, -1e-6),
        "action_rate": term(rewards.action_rate, (-0.01, -0.005)),
        "smoothness": term(rewards.smoothness, (-0.005, -0.0025)),
        "roll_pitch_rate": term(rewards.roll_pitch_rate, (-0.02, -0.3)),
        "orientation": term(rewards.unwanted_tilt, (-5.0, -100.0)),
        "base_height": term(rewards.base_height, (-10.0, -20.0)),
        "joint_acceleration": term(rewards.joint_acceleration, (-2.5e-7, -3e-8)),
        "abduction": term(rewards.abduction, (-1.0, 0.0)),
        "collision": term(rewards.collision, -1.0, height=0.1),
        "foot_slip": term(rewards.foot_slip, (0.0, -0.01)),
        "yaw_rate": term(rewards.yaw_rate_error, (0.0, -0.5)),
        "foot_clearance": term(rewards.swing_clearance, (-0.2, 0.0), height=0.11),
        "abduction_mirror": term(rewards.abduction_mirror, (0.0, -0.5)),
        "grounded": term(rewards.grounded, (-0.03, 0.0)),
        "touchdown": term(rewards.touchdown, (0.0, -0.03), height=0.05),
        "electrical_power": term(rewards.electrical_power, (-0.2, -0.5), speed=2.0),
        "hasty_touchdowns": term(rewards.hasty_touchdowns, (-2.0, -10.0)),
        "short_stances": term(rewards.short_stances, (-1.0, -6.0)),
        "motion_at_zero_command": term(rewards.motion_at_zero_command, (-0.5, -3.0), speed=1.0),
        "sideways_drift": term(rewards.sideways_drift, (0.0, -2.0)),
    }


def paper_rewards() -> Rewards:
    """The paper's Table I as printed; zero where it has N/A.

    How the terms are added it does not say: as by default, tracking times exp(penalties / 2), since a plain
    sum rewards an early end at an orientation weight of -100.
    """
    return {
        # Part A: constant weights
        "linear_tracking": term(rewards.linear_tracking, 1.0, speed=1.0),
        "angular_tracking": term(rewards.angular_tracking, 0.5, sharpness=1.0),
        "vertical_velocity": term(rewards.vertical_velocity, -2.0),
        "joint_power": term(rewards.joint_power, -1.0e-6),
        "action_rate": term(rewards.action_rate, -0.01),
        "smoothness": term(rewards.smoothness, -0.005),
        "joint_limit": term(rewards.joint_limit, -10.0),
        # Part B: weights of stage 1 and stage 2
        "roll_pitch_rate": term(rewards.roll_pitch_rate, (-0.02, -0.5)),
        "orientation": term(rewards.tilt, (-5.0, -100.0)),
        "base_height": term(rewards.base_height, (-10.0, -20.0)),
        "joint_acceleration": term(rewards.joint_acceleration, (-2.5e-7, -1.0e-7)),
        "abduction": term(rewards.abduction, (-1.0, 0.0)),
        "collision": term(rewards.collision, (-1.0, 0.0), height=0.1),
        "foot_slip": term(rewards.foot_slip, (0.0, -0.01)),
        "yaw_rate": term(rewards.yaw_rate, (0.0, -0.5)),
        "foot_clearance": term(rewards.foot_clearance, (-0.2, 0.0), height=0.11),
        "abduction_mirror": term(rewards.abduction_mirror, (0.0, -0.5)),
    }


def hound_rewards() -> Rewards:
    """Hound's (2312.17507): its gait and foot terms, base and torque terms, tracking kernels.

    All weights are the paper's divided by six, which makes linear tracking one as in the other tables. Its
    contact velocity is our ``touchdown``: the squared downward speed of a foot that is about to touch. Terms
    that keep a simulated robot possible stay (end stops, legs, knees, no-load speed). The sum is clipped at
    zero; how Hound adds its terms we could not read.
    """
    return {
        "linear_tracking": term(rewards.linear_tracking, 1.0, speed=1.0),
        "angular_tracking": term(rewards.angular_tracking, 0.5, sharpness=1.5),
        "vertical_velocity": term(rewards.vertical_velocity, -4.0 * 0.8 / 6.0),
        "joint_limit": term(rewards.joint_limit, -10.0),
        "collision": term(rewards.collision, -1.0, height=0.1),
        "foot_slip": term(rewards.foot_slip, -0.16 / 6.0),
        "touchdown": term(rewards.touchdown, -6.0 / 6.0, height=0.05),
        "over_speed": term(rewards.over_speed, -60.0 / 6.0),
        "leg_distance": term(rewards.leg_distance, -12.0 / 6.0, distance=0.04),
        "diagonal_contact": term(rewards.diagonal_contact, 1.2 / 6.0),
        "tilt_rate": term(rewards.tilt_rate, -4.0 * 0.2 / 6.0),
        "torque": term(rewards.torque, -2e-4 / 6.0),
    }
