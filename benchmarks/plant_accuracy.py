"""Measure the plant: drops of a leg, steps, and what three solver iterations leave in training.

    python benchmarks/plant_accuracy.py

Prints the tables of docs/evaluation.md; a few minutes on one core.
"""

from __future__ import annotations

import argparse
from itertools import product

import mujoco
import numpy as np
from foot_drop import drop_test, expected_drop

from sprintlab.control import load_policy, shipped_policy
from sprintlab.evaluation.trial import TrialRequest, run_trial
from sprintlab.plant import PlantOptions
from sprintlab.robots import (
    DRAG_AREA,
    FootContact,
    build_model,
    effective_leg_mass,
    load_robot,
)
from sprintlab.training.environment.simulation import training_model
from sprintlab.training.settings import SimulationSettings

PHASES = (0.1, 0.35, 0.6, 0.85)
"""Of a time step, at which a dropped leg touches down."""
STEPS = (0.00025, 0.001, 0.0025)
"""Of the plant, of a coarse check, of training [s]."""


def drops(mass: float) -> None:
    """The drop test over the band: mean of four touchdown phases."""
    print("\n| stiffness [kN/m] | restitution | step [ms] | stiffness shown | restitution shown | pad [mm] |")
    print("|---|---|---|---|---|---|")
    for stiffness, restitution, step in product((40e3, 80e3, 160e3), (0.2, 0.4, 0.6), STEPS):
        foot = FootContact(stiffness=stiffness, restitution=restitution)
        found = [drop_test(foot, mass, 4.0, step, phase) for phase in PHASES]
        shown = [np.mean([getattr(drop, name) for drop in found]) for name in ("stiffness", "restitution")]
        pad = np.mean([drop.deflection for drop in found])
        wanted = expected_drop(foot, mass, 4.0).deflection
        print(
            f"| {stiffness / 1e3:g} | {restitution:g} | {step * 1e3:g} | {shown[0] / 1e3:.0f} "
            f"| {shown[1]:.2f} | {pad * 1e3:.1f} ({wanted * 1e3:.1f}) |"
        )


def steps(name: str, top_speed: float) -> None:
    """One nominal trial of a policy under other steps, pads and air."""
    policy = load_policy(shipped_policy(name))
    robot = load_robot(policy.contract.robot_name)
    print(f"\n| {name} at {top_speed:g} m/s | held [m/s] | bus power [W] | pad [mm] | foot force [bw] |")
    print("|---|---|---|---|---|")
    variants = {
        "0.25 ms, nominal": {},
        "0.125 ms": {"timestep": 0.000125},
        "0.5 ms": {"timestep": 0.0005, "contact_time_constant": 0.001},
        "40 kN/m": {"foot": FootContact(stiffness=40e3)},
        "160 kN/m": {"foot": FootContact(stiffness=160e3)},
        "restitution 0.2": {"foot": FootContact(restitution=0.2)},
        "restitution 0.6": {"foot": FootContact(restitution=0.6)},
        "no air": {"drag_area": 0.0},
        "air, 4/3": {"drag_area": DRAG_AREA * 4 / 3},
    }
    held = {}
    for label, changed in variants.items():
        request = TrialRequest(top_speed=top_speed, hold=4.0, plant=PlantOptions(**changed))
        found = run_trial(policy, robot, request).metrics
        print(
            f"| {label} | {found.held_speed:.2f} | {found.electrical_power:.0f} "
            f"| {found.pad_deflection * 1e3:.1f} | {found.foot_force:.1f} |",
            flush=True,
        )
        held[label] = found.held_speed
    print("\n" + bands(held))


def bands(held: dict[str, float]) -> str:
    """How far steps, pad and air move a held speed at most [m/s]."""
    nominal, *others = held
    causes = {"steps": " ms", "stiffness": " kN/m", "restitution": "restitution", "air": "air"}
    moved = {
        cause: max(abs(held[label] - held[nominal]) for label in others if word in label)
        for cause, word in causes.items()
    }
    return "held speed moves at most by: " + ", ".join(f"{cause} {by:.2f}" for cause, by in moved.items())


def solver(iterations: tuple[int, ...] = (2, 3, 4)) -> None:
    """Base velocity after one training step, against a converged solver, feet in contact."""
    robot = load_robot("bp2")
    converged = training_model(robot, SimulationSettings(solver_iterations=100, line_search_iterations=50))
    print("\n| Newton iterations | mean error [m/s] | 99 of 100 steps below [m/s] |\n|---|---|---|")
    for count in iterations:
        model = training_model(robot, SimulationSettings(solver_iterations=count))
        errors = [_step_errors(robot, model, converged, speed) for speed in (1.0, 6.0, 12.0)]
        error = np.concatenate(errors)
        print(f"| {count} | {error.mean():.4f} | {np.quantile(error, 0.99):.3f} |")


def _step_errors(robot, model, converged, speed: float) -> np.ndarray:
    """Errors of single steps, each from the state of the run, with targets that jump every 25 ms."""
    data, exact = mujoco.MjData(model), mujoco.MjData(converged)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    random, offset, errors = np.random.default_rng(0), np.zeros(12), []
    data.qvel[:3], data.qpos[2] = (speed, 0.0, -1.5), data.qpos[2] + 0.02
    position = [model.joint(name).qposadr[0] for name in robot.joint_names]
    velocity = [model.joint(name).dofadr[0] for name in robot.joint_names]
    for step in range(160):
        if step % 10 == 0:
            offset = random.uniform(-0.5, 0.5, 12)
        wanted = robot.default_pose + offset - data.qpos[position]
        data.ctrl[:] = np.clip(160.0 * wanted - 4.9 * data.qvel[velocity], -70.0, 70.0)
        for field in ("qpos", "qvel", "ctrl", "qacc_warmstart"):
            getattr(exact, field)[:] = getattr(data, field)
        exact.qacc_warmstart[:] = data.qacc
        mujoco.mj_step(converged, exact)
        mujoco.mj_step(model, data)
        if exact.ncon:
            errors.append(float(np.abs(data.qvel[:3] - exact.qvel[:3]).max()))
    return np.array(errors)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("policy", nargs="?", default="sprint", help="a policy of the package")
    parser.add_argument("speed", nargs="?", type=float, default=13.25, help="its command [m/s]")
    chosen = parser.parse_args()
    leg = effective_leg_mass(build_model(load_robot("bp2")))
    print(f"effective mass of a leg: {leg:.2f} kg")
    drops(leg)
    solver()
    steps(chosen.policy, chosen.speed)
