"""Train the shipped policy ``sprint``: four trainings, two means.

    python recipes/sprint.py --output runs/sprint
    sprintlab calibrate runs/sprint/policy.onnx runs/sprint/sprint.onnx --top-speed 13.25 --lead 2
    sprintlab race runs/sprint/sprint.onnx --top-speed 13.25
    python recipes/sprint.py --robot go1 --output runs/go1-sprint    # the same at another robot's size

The first training begins from nothing. The second goes on from it with targets that stay long enough for a
robot to reach its top speed, which takes ten seconds. The mean of their weights is fast, but drives its knees
into their end stops and drifts to the side. The third and the fourth begin from that mean and make such
faults dear. The mean of one fifth of it and four fifths of the fourth training has neither's faults: it
passes the audit over 22 runs, and neither of the two does. About ten minutes of one H100 where two
trainings share it.

That was one seed of five. From seeds 1 to 4 the same recipe gives 11.96, 10.90, 9.36 and 11.61 m/s instead of
12.44, and none of them passes the audit: ``results/ninth-looks/trainings.json`` and
``results/tenth-looks/trainings.json``.

The file of the package was made so but for two things. Its first mean also holds two networks on the way and
6 % of a further training: ``results/fifth-looks/trainings.json``, ``fast``. And drift to the side cost in
turns as well then. The network turns badly; a loop on the gyroscope, of which the policy's contract says how
it works, makes up for it. So do tables, measured by ``sprintlab calibrate``, for what it runs too slowly and
for what it estimates too low; without them the lead is a longer one, since the estimate is too low.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from sprintlab.api.training import ScriptOptions, run_script, train_settings
from sprintlab.control.pace import PaceContract
from sprintlab.control.turning import TurningContract
from sprintlab.training.methods import method_settings
from sprintlab.training.scaling import scaled_pace, scaled_settings, scaled_turning
from sprintlab.training.settings import RewardWeight, TrainingSettings

ENDS = {"first": 1750, "second": 3300, "third": 4700, "fourth": 6100}
"""Iteration at which each training ends."""


@dataclass(frozen=True, kw_only=True)
class RecipeOptions(ScriptOptions):
    """What this script reads from its command line.

    Attributes:
        robot: name, folder or table of the robot to train: lengths, speeds, times and masses of all four
            trainings are scaled to it.
    """

    robot: str = "bp2"


DEFAULTS = RecipeOptions(output=Path("runs/sprint"), iterations=ENDS["fourth"], minutes=60.0)
SHARES = (0.1, 0.1, 0.8)
"""Of the ends of the first, the second and the fourth training in the policy."""
PACE = PaceContract(power=30.0, lead=3.0)
"""How fast the policy's forward command falls at most: braking harder, a front foot presses too much. And how
far it runs ahead of the robot: asked for much more than they can, heavy and weak robots fall."""
TURNING = TurningContract(fastest=12.75, integral=3.0)
"""How much more than the commanded yaw rate the policy is asked for: by itself it turns too little. Commanded
12 m/s, the calibrated network is given 12.74."""


def first_settings() -> TrainingSettings:
    """From nothing: the defaults, with a fine-tuning phase that begins and ends a little later."""
    base = method_settings("sprint", TrainingSettings(robot="bp2", seed=12))
    return replace(
        base,
        stages=replace(base.stages, steady_iteration=900),
        ppo=replace(base.ppo, precision="bfloat16", calm_iterations=(900, 1600)),
    )


def second_settings() -> TrainingSettings:
    """Time at the top: longer targets and episodes, a range that runs ahead; softer feet, longer strides."""
    base = first_settings()
    assert base.schedule.targets is not None
    targets = replace(base.schedule.targets, persistence=(5.0, 12.0), top_share=0.45)
    return replace(
        base,
        schedule=replace(base.schedule, targets=targets),
        stages=replace(base.stages, growth_margin=1.5),
        episodes=replace(base.episodes, duration=(14.0, 24.0)),
        ppo=replace(base.ppo, least_std=0.22, calm_iterations=(2050, 3050)),
        rewards=replace(
            base.rewards,
            fine_speed_tracking=4.0,
            fine_speed=0.8,
            fine_yaw_tracking=3.5,
            foot_force_limit=2.5,
            foot_force=RewardWeight(first=-0.5, second=-8.0),
            shortest_stride=0.205,
        ),
    )


def third_settings() -> TrainingSettings:
    """No end stops, no drift to the side, half of the commands as ramps: as an evaluation commands."""
    base = second_settings()
    begin, end = ENDS["second"], ENDS["third"]
    return replace(
        base,
        seed=31,
        schedule=replace(base.schedule, ramp_share=0.5),
        ppo=replace(base.ppo, least_std=0.18, most_std=0.30, calm_iterations=(begin + 350, end - 150)),
        rewards=replace(
            base.rewards,
            foot_force=RewardWeight(first=-0.5, second=-10.0),
            joint_limit=RewardWeight(first=-10.0, second=-300.0),
            gear_torque=RewardWeight(first=-0.05, second=-0.5),
            sideways_drift=RewardWeight(first=0.0, second=-1.0),
        ),
    )


def fourth_settings() -> TrainingSettings:
    """Softer feet still."""
    base = third_settings()
    begin, end = ENDS["third"], ENDS["fourth"]
    return replace(
        base,
        ppo=replace(base.ppo, least_std=0.16, calm_iterations=(begin + 200, end - 150)),
        rewards=replace(
            base.rewards,
            foot_force_limit=2.4,
            foot_force=RewardWeight(first=-0.5, second=-14.0),
            sideways_drift=RewardWeight(first=0.0, second=-1.5),
        ),
    )


def main(options: RecipeOptions) -> Path:
    """Train four times; returns the policy file. ``--resume`` goes on in the training that was stopped.

    Raises:
        SprintlabError: the extra is not installed, or an option or the output folder is refused.
    """
    from sprintlab.training.runs.averaging import average_checkpoints

    first = _train(first_settings(), options, "first")
    second = _train(second_settings(), options, "second", first)
    begun = average_checkpoints((first, second), options.output / "begun.onnx").path
    third = _train(third_settings(), options, "third", begun)
    fourth = _train(fourth_settings(), options, "fourth", third)
    ends = (first, second, fourth)
    pace, turning = scaled_pace(options.robot, PACE), scaled_turning(options.robot, TURNING)
    return average_checkpoints(ends, options.output / "policy.onnx", SHARES, pace, turning).path


def _train(
    settings: TrainingSettings, options: RecipeOptions, name: str, start_from: Path | None = None
) -> Path:
    """Train in a folder of its own, or go on there; returns the checkpoint. Errors as in ``main``."""
    end = max(1, round(options.iterations * ENDS[name] / ENDS["fourth"]))
    folder = options.output / name
    resume = options.resume and (folder / "checkpoint.pt").exists()
    chosen = vars(replace(options, output=folder, iterations=end, resume=resume))
    own = scaled_settings(chosen.pop("robot"), settings, settings)
    return train_settings(own, keep_schedule=True, start_from=None if resume else start_from, **chosen)


if __name__ == "__main__":
    run_script(main, DEFAULTS)
