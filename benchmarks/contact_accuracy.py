"""What coarse physics costs: a shipped policy under training's contact and solver choices, in MuJoCo C.

    python benchmarks/contact_accuracy.py --output results/accuracy/contact.json --markdown docs/accuracy.md

The reference is the evaluation plant: 0.25 ms steps, elliptic cone, 0.5 ms contact, every leg collides, motor
loop at 1 kHz. Each variant is the model that training steps on a GPU (feet on a floor, explicit Euler, smooth
dry friction, motor law in every physics step), here in double precision in MuJoCo C. Both run the same seeded
trials: stand 0.5 s, rise at 4 m/s^2, hold 4 s; speed and energy are means over the last 2 s.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import platform
import shlex
import statistics
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass
from datetime import datetime
from importlib import metadata
from itertools import product
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from rich.progress import track
from studies.paper.pages import replace_section

from sprintlab.commands import SpeedProfile, heading_command
from sprintlab.control import (
    Measurement,
    PolicyRuntime,
    load_policy,
    pd_torque,
    projected_gravity,
    shipped_policy,
)
from sprintlab.core.files import atomic_write_json
from sprintlab.evaluation.protocol import ProtocolSettings
from sprintlab.motors import electrical_power
from sprintlab.plant import BaseState, Plant, PlantOptions, PreparedDrive, TrialSettings
from sprintlab.robots import ModelOptions, RobotDescription, build_model, load_robot, soft_stop_torque

POLICY_STEP = 0.02
"""[s]"""
STEADY = 2.0
"""Speed and energy are means over this last part of the hold [s]."""
FRICTION_SPEED = 0.2
"""Dry friction is a tanh of joint speed over this, as in the training kernel [rad/s]."""
LOWEST_BASE = 0.2
"""Where only feet collide, a base below this height has fallen [m]."""
GRAVITY = 9.81
MOTOR_STEP = 0.001
CONVERGED = 100
"""Solver iterations that no step uses up."""
PACKAGES = ("sprintlab", "mujoco", "numpy", "onnxruntime")


@dataclass(frozen=True, kw_only=True)
class Variant:
    """One choice of training's physics.

    Attributes:
        group: which table it belongs to.
        timestep: physics step [s]; a whole number of them makes a policy step.
        time_constant: of the contacts [s].
        cone: friction cone.
        iterations: of the Newton solver.
        integrator: ``"euler"`` or ``"implicitfast"``.
        knee_spring: whether the passive knee springs are there.
    """

    group: str
    timestep: float = 0.002
    time_constant: float = 0.004
    cone: str = "pyramidal"
    iterations: int = 6
    integrator: str = "euler"
    knee_spring: bool = True

    @property
    def substeps(self) -> int:
        """Physics steps in one policy step."""
        return round(POLICY_STEP / self.timestep)

    def model_options(self) -> ModelOptions:
        """As ``sprintlab.training.environment.simulation.training_model`` compiles the robot."""
        return ModelOptions(
            timestep=self.timestep,
            collisions="feet",
            contact_time_constant=self.time_constant,
            cone=self.cone,
            integrator=self.integrator,
            dry_friction=False,
            joint_limits=False,
            knee_spring=self.knee_spring,
        )


STEPS = (0.001, 0.002, 0.0025, 0.02 / 6, 0.004, 0.005)
FINE_STEPS = (0.00025, 0.0005)
TIME_CONSTANTS = (0.002, 0.004, 0.005, 0.006, 0.008, 0.010)
ITERATIONS = (1, 2, 3, 4, 6, 10, CONVERGED)


def stiffest(group: str, step: float, **choices: Any) -> Variant:
    """A variant whose contact is as stiff as its step allows."""
    return Variant(group=group, timestep=step, time_constant=2.0 * step, **choices)


def variants() -> list[Variant]:
    """Every row, group by group."""
    steps = [
        Variant(group="step", timestep=step, time_constant=max(0.004, 2.0 * step))
        for step in (*FINE_STEPS, *STEPS)
    ]
    contacts = [
        Variant(group="contact", timestep=step, time_constant=constant)
        for step, constant in product(STEPS, TIME_CONSTANTS)
        if constant >= 2.0 * step - 1e-9
    ]
    cones = [stiffest("cone", step, cone=cone) for step, cone in product(STEPS, ("pyramidal", "elliptic"))]
    iterations = [
        stiffest("iterations", step, iterations=count) for step, count in product((0.002, 0.0025), ITERATIONS)
    ]
    others = [
        stiffest("integrator and spring", step, integrator=integrator, knee_spring=spring)
        for step, integrator, spring in product(STEPS[1:], ("euler", "implicitfast"), (True, False))
    ]
    return [*steps, *contacts, *cones, *iterations, *others]


@dataclass(frozen=True, kw_only=True)
class Trial:
    """One run to make: ``variant`` None is the reference plant."""

    variant: Variant | None
    top_speed: float
    settings: TrialSettings


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """What one run gave; speed, energy and duty are means over the last 2 s of the hold.

    ``physics_time`` is the processor time that MuJoCo's step took for one policy step [s].
    """

    fell: bool
    speed: float
    cost_of_transport: float
    duty: float
    penetration: float
    physics_time: float


class Samples:
    """Sums up a run; for the plant it stands in for its recorder."""

    def __init__(self, robot: RobotDescription, model: mujoco.MjModel, mass: float) -> None:
        self._robot, self._mass = robot, mass
        self._feet = np.array([model.geom(f"{leg}_foot").id for leg in robot.leg_names])
        self._joints = np.array([model.joint(name).dofadr[0] for name in robot.joint_names])
        self.steady = False
        self._way = self._energy = self._time = self._contact = 0.0
        self.penetration = 0.0

    def watch_step(self, data: mujoco.MjData) -> None:
        """The deepest that a foot sinks in any physics step."""
        depth = self._robot.foot_radius - float(data.geom_xpos[self._feet, 2].min())
        self.penetration = max(self.penetration, depth)

    def sample(self, data: mujoco.MjData, drive: Any, targets: Any, step: float = MOTOR_STEP) -> None:
        """Take speed and power of one motor step."""
        self.watch_step(data)
        if not self.steady:
            return
        speed = data.qvel[self._joints] * self._robot.gear.ratio
        power = float(electrical_power(self._robot.motors, drive.motor_torque, speed).sum())
        heading = _heading(data.qpos)
        self._way += step * float(data.qvel[0] * np.cos(heading) + data.qvel[1] * np.sin(heading))
        self._energy += step * max(power, 0.0)
        self._contact += step * float((data.geom_xpos[self._feet, 2] < self._robot.foot_radius).mean())
        self._time += step

    def outcome(self, fell: bool, physics_time: float) -> Outcome:
        """The run in numbers; NaN where it ended before the steady part."""
        known = not fell and self._way > 0.0
        nan = float("nan")
        return Outcome(
            fell=fell,
            speed=self._way / self._time if known else nan,
            cost_of_transport=self._energy / (self._mass * GRAVITY * self._way) if known else nan,
            duty=self._contact / self._time if known else nan,
            penetration=self.penetration,
            physics_time=physics_time,
        )


class ReferenceWorld:
    """The evaluation plant."""

    def __init__(self, robot: RobotDescription, settings: TrialSettings) -> None:
        self._plant = Plant(robot, PlantOptions(record_rate=1000.0), settings)
        self.model, self.measurement = self._plant.model, self._plant.measurement
        self.base_state = self._plant.base_state
        self.physics_time = float("nan")

    def advance(self, targets: np.ndarray, samples: Samples) -> bool:
        """One policy step; False after a fall."""
        return self._plant.advance(targets, round(POLICY_STEP / MOTOR_STEP), samples)  # type: ignore[arg-type]


class TrainingWorld:
    """The model that training steps, in MuJoCo C: the motor law is evaluated in every physics step."""

    def __init__(self, robot: RobotDescription, settings: TrialSettings, variant: Variant) -> None:
        self.robot, self.variant = robot, variant
        self.model = build_model(robot, variant.model_options())
        self.model.opt.iterations = variant.iterations
        self.model.opt.ls_iterations = max(12, 2 * variant.iterations)
        # A diverging state must end the trial, not silently start it anew.
        self.model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
        self.model.geom_friction[:, 0] = settings.friction
        self.model.body_mass[self.model.body("trunk").id] += settings.payload
        mujoco.mj_setConst(self.model, mujoco.MjData(self.model))
        self.data = mujoco.MjData(self.model)
        self.physics_time = 0.0
        self._drive = PreparedDrive(robot, robot.bus_voltage)
        self._position = np.array([self.model.joint(name).qposadr[0] for name in robot.joint_names])
        self._velocity = np.array([self.model.joint(name).dofadr[0] for name in robot.joint_names])
        self._place(settings)

    def _place(self, settings: TrialSettings) -> None:
        """As the plant places its robot: default pose with the trial's noise, feet on the ground."""
        mujoco.mj_resetDataKeyframe(self.model, self.data, self.model.key("stand").id)
        random = np.random.default_rng(settings.seed)
        self.data.qpos[self._position] += random.uniform(-settings.joint_noise, settings.joint_noise, 12)
        mujoco.mj_kinematics(self.model, self.data)
        lowest = min(self.data.geom(f"{leg}_foot").xpos[2] for leg in self.robot.leg_names)
        self.data.qpos[2] += self.robot.foot_radius - lowest

    def measurement(self) -> Measurement:
        """What the policy sees."""
        return Measurement(
            angular_velocity=self.data.qvel[3:6].copy(),
            projected_gravity=np.asarray(projected_gravity(self.data.qpos[3:7])),
            joint_position=self.data.qpos[self._position],
            joint_velocity=self.data.qvel[self._velocity],
        )

    def base_state(self) -> BaseState:
        """What the heading loop sees."""
        heading = _heading(self.data.qpos)
        vx, vy = self.data.qvel[:2]
        return BaseState(
            forward_speed=float(vx * np.cos(heading) + vy * np.sin(heading)),
            heading=heading,
            lateral_offset=float(self.data.qpos[1]),
            distance=float(self.data.qpos[0]),
        )

    def advance(self, targets: np.ndarray, samples: Samples) -> bool:
        """One policy step; False after a fall or when the state is no longer finite."""
        robot, step = self.robot, self.variant.timestep
        for _ in range(self.variant.substeps):
            position, velocity = self.data.qpos[self._position], self.data.qvel[self._velocity]
            wanted = pd_torque(robot.stiffness, robot.damping, targets, position, velocity)
            drive = self._drive(wanted, velocity)
            stop = soft_stop_torque(position, velocity, robot.position_limits, robot.soft_stop)
            friction = robot.dry_friction * np.tanh(velocity / FRICTION_SPEED)
            self.data.ctrl[:] = drive.torque - friction + stop
            samples.sample(self.data, drive, targets, step)
            started = time.process_time()
            mujoco.mj_step(self.model, self.data)
            self.physics_time += time.process_time() - started
        x, y = self.data.qpos[4:6]
        finite = bool(np.isfinite(self.data.qpos).all() and np.isfinite(self.data.qvel).all())
        return finite and 1.0 - 2.0 * (x * x + y * y) > 0.5 and float(self.data.qpos[2]) > LOWEST_BASE


def _heading(qpos: np.ndarray) -> float:
    w, x, y, z = qpos[3:7]
    return float(np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)))


_worker: dict[str, Any] = {}


def _load(policy: Path) -> None:
    mujoco.set_mju_user_warning(lambda _: None)  # a run that diverges is counted as a fall, not logged
    loaded = load_policy(policy)
    _worker.update(robot=load_robot(loaded.contract.robot_name), policy=loaded)


def run(trial: Trial) -> Outcome:
    """One run of one trial in a worker."""
    robot: RobotDescription = _worker["robot"]
    world: ReferenceWorld | TrainingWorld = (
        ReferenceWorld(robot, trial.settings)
        if trial.variant is None
        else TrainingWorld(robot, trial.settings, trial.variant)
    )
    runtime = PolicyRuntime(_worker["policy"], robot)
    samples = Samples(robot, world.model, robot.total_mass + trial.settings.payload)
    profile = SpeedProfile(top_speed=trial.top_speed, stand=0.5)
    end = profile.hold_interval[1]
    steps, upright = round(end / POLICY_STEP), True
    for index in range(steps):
        now, base = index * POLICY_STEP, world.base_state()
        samples.steady = now >= end - STEADY - 1e-9
        speed = float(profile.command(now))
        turn = float(heading_command(base.heading, base.lateral_offset, speed))
        targets = runtime.step(world.measurement(), np.array([speed, 0.0, turn]))
        upright = world.advance(np.asarray(targets, dtype=float), samples)
        if not upright:
            break
    return samples.outcome(not upright, world.physics_time / (index + 1))


@dataclass(frozen=True, kw_only=True)
class Row:
    """One variant at one command, means over the trials that completed; errors against the reference.

    The spread is the standard error of the mean speed difference over the trials.
    """

    top_speed: float
    falls: int
    trials: int
    speed: float | None
    speed_error: float | None
    speed_error_spread: float | None
    cost_of_transport: float | None
    energy_error_percent: float | None
    duty: float | None
    penetration_mm: float | None
    physics_us: float | None


def summarize(top_speed: float, outcomes: list[Outcome], reference: list[Outcome]) -> Row:
    """Compare trial by trial, so that friction and payload cancel."""
    pairs = [(o, r) for o, r in zip(outcomes, reference, strict=True) if not o.fell and not r.fell]
    done = [outcome for outcome, _ in pairs]
    errors = [o.speed - r.speed for o, r in pairs]
    energy = [100.0 * (o.cost_of_transport / r.cost_of_transport - 1.0) for o, r in pairs]
    times = [outcome.physics_time for outcome in outcomes if np.isfinite(outcome.physics_time)]
    return Row(
        top_speed=top_speed,
        falls=sum(outcome.fell for outcome in outcomes),
        trials=len(outcomes),
        speed=_mean([outcome.speed for outcome in done]),
        speed_error=_mean(errors),
        speed_error_spread=statistics.stdev(errors) / len(errors) ** 0.5 if len(errors) > 1 else None,
        cost_of_transport=_mean([outcome.cost_of_transport for outcome in done]),
        energy_error_percent=_mean(energy),
        duty=_mean([outcome.duty for outcome in done]),
        penetration_mm=1e3 * max(outcome.penetration for outcome in done) if done else None,
        physics_us=1e6 * statistics.median(times) if times else None,
    )


def _mean(values: list[float]) -> float | None:
    return float(np.mean(values)) if values else None


def measure(arguments: argparse.Namespace) -> dict[str, Any]:
    """Run everything; the result as JSON-ready values."""
    settings = ProtocolSettings(trials=arguments.trials, required=1).trial_settings()
    rows: list[Variant | None] = [None, *variants()]
    trials = [
        Trial(variant=variant, top_speed=speed, settings=each)
        for variant in rows
        for speed in arguments.speeds
        for each in settings
    ]
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(arguments.workers, context, _load, (arguments.policy,)) as pool:
        outcomes = list(track(pool.map(run, trials), "running", len(trials), transient=True))
    table = _by_variant(rows, arguments.speeds, outcomes, len(settings))
    return {
        "command": shlex.join([Path(sys.executable).name, *sys.argv]),
        "date": datetime.now().astimezone().isoformat(timespec="seconds"),
        "machine": f"{arguments.workers} x86 processes, Python {platform.python_version()}",
        "versions": {name: metadata.version(name) for name in PACKAGES},
        "policy": arguments.policy.stem,
        "trials": len(settings),
        "reference": table[0]["rows"],
        "variants": table[1:],
    }


def _by_variant(
    rows: list[Variant | None], speeds: list[float], outcomes: list[Outcome], trials: int
) -> list[dict[str, Any]]:
    grid = np.array(outcomes, dtype=object).reshape(len(rows), len(speeds), trials)
    reference = grid[0]
    return [
        {
            "variant": None if variant is None else asdict(variant),
            "rows": [
                asdict(summarize(speed, list(grid[index, column]), list(reference[column])))
                for column, speed in enumerate(speeds)
            ],
        }
        for index, variant in enumerate(rows)
    ]


def _number(value: float | None, digits: int, sign: bool = False) -> str:
    return "-" if value is None else f"{value:{'+' if sign else ''}.{digits}f}"


def _cells(variant: dict[str, Any], row: dict[str, Any]) -> dict[str, str]:
    """One row of a table by column."""
    spread = row["speed_error_spread"]
    error = _number(row["speed_error"], 2, sign=True) + ("" if spread is None else f" ± {spread:.2f}")
    return {
        "step [ms]": f"{1e3 * variant['timestep']:.3g}",
        "contact [ms]": f"{1e3 * variant['time_constant']:.3g}",
        "cone": variant["cone"],
        "iterations": "no limit" if variant["iterations"] == CONVERGED else str(variant["iterations"]),
        "integrator": variant["integrator"],
        "knee spring": "yes" if variant["knee_spring"] else "no",
        "falls": f"{row['falls']} of {row['trials']}",
        "held speed [m/s]": _number(row["speed"], 2),
        "speed error [m/s]": error,
        "energy error [%]": _number(row["energy_error_percent"], 1, sign=True),
        "duty": _number(row["duty"], 2),
        "sinks [mm]": _number(row["penetration_mm"], 1),
        "physics [µs]": _number(row["physics_us"], 0),
    }


INTRODUCTION = """Policy `{policy}`, {trials} seeded trials. Measured with

```sh
{command}
```

({machine}, {versions}, {date})

"""


def tables(result: dict[str, Any]) -> str:
    """How it was measured, and one table a command and group."""
    facts = {key: result[key] for key in ("policy", "trials", "machine", "date", "command")}
    versions = ", ".join(f"{name} {version}" for name, version in result["versions"].items())
    parts = [INTRODUCTION.format(**facts, versions=versions)]
    groups = list(dict.fromkeys(entry["variant"]["group"] for entry in result["variants"]))
    for column, reference in enumerate(result["reference"]):
        parts.append(f"## Command {reference['top_speed']:g} m/s\n\n{_reference_text(reference)}\n\n")
        for group in groups:
            entries = [entry for entry in result["variants"] if entry["variant"]["group"] == group]
            rows = [_cells(entry["variant"], entry["rows"][column]) for entry in entries]
            parts.append(f"### By {group}\n\n{_table(rows)}\n")
    return "".join(parts).rstrip()


def _reference_text(row: dict[str, Any]) -> str:
    return (
        f"Reference: {_number(row['speed'], 2)} m/s, cost of transport "
        f"{_number(row['cost_of_transport'], 3)}, duty {_number(row['duty'], 2)}, feet sink "
        f"{_number(row['penetration_mm'], 1)} mm, {row['falls']} of {row['trials']} fell."
    )


def _table(rows: list[dict[str, str]]) -> str:
    """Markdown, without the columns of settings that are the same in every row."""
    settings = ("cone", "iterations", "integrator", "knee spring")
    same = {name for name in settings if len({row[name] for row in rows}) == 1}
    names = [name for name in rows[0] if name not in same]
    lines = [" | ".join(names), " | ".join("---" for _ in names)]
    lines += [" | ".join(row[name] for name in names) for row in rows]
    return "\n".join(f"| {line} |" for line in lines) + "\n"


def parse() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--policy", type=Path, default=shipped_policy("sprint"))
    parser.add_argument("--speeds", type=float, nargs="+", default=[8.0, 12.0], help="commands [m/s]")
    parser.add_argument("--trials", type=int, default=6)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--output", type=Path, help="write the result here as JSON")
    parser.add_argument("--markdown", type=Path, help="put the tables between this page's marks")
    parser.add_argument("--render", type=Path, help="take the result from this JSON instead of measuring")
    return parser.parse_args()


def main() -> int:
    arguments = parse()
    if arguments.render is not None:
        result = json.loads(arguments.render.read_text(encoding="utf-8"))
    else:
        result = measure(arguments)
    if arguments.output is not None:
        atomic_write_json(arguments.output, result)
    if arguments.markdown is not None:
        replace_section(arguments.markdown, "contact", tables(result))
    if arguments.output is None and arguments.markdown is None:
        print(json.dumps(result, indent=2))
    return 0


if __name__ == "__main__":
    sys.exit(main())
