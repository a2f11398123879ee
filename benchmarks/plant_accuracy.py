"""Measure the plant: drops of a leg on its pad, and what steps, pads and air do to a running robot.

    python benchmarks/plant_accuracy.py

Prints the tables of docs/evaluation.md; a few minutes on one core.
"""

from __future__ import annotations

import argparse
from itertools import product

import numpy as np
from foot_drop import drop_test, exact_drop

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

PHASES = (0.1, 0.35, 0.6, 0.85)
"""Shares of a time step at which a dropped leg touches down."""


def drops(mass: float) -> None:
    """Drops at the plant's step against the exact solution: mean of four touchdown phases."""
    print("\n| stiffness [kN/m] | restitution | along [m/s] | restitution shown | peak force | pad [mm] |")
    print("|---|---|---|---|---|---|")
    for stiffness, restitution, along in product((40e3, 80e3, 160e3), (0.2, 0.4, 0.6), (0.0, 6.0)):
        foot = FootContact(stiffness=stiffness, restitution=restitution)
        exact = exact_drop(foot, mass, 4.0)
        found = [drop_test(foot, mass, (4.0, along), PlantOptions().timestep, phase) for phase in PHASES]
        bounce, force, pad = (
            np.mean([getattr(drop, name) for drop in found])
            for name in ("restitution", "peak_force", "deflection")
        )
        wrong = 100.0 * (force / exact.peak_force - 1.0)
        print(
            f"| {stiffness / 1e3:g} | {restitution:g} | {along:g} | {bounce:.3f} "
            f"| {wrong:+.1f} % | {pad * 1e3:.1f} ({exact.deflection * 1e3:.1f}) |"
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
        request = TrialRequest(top_speed=top_speed, plant=PlantOptions(**changed))
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


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("policy", nargs="?", default="sprint", help="a policy of the package")
    parser.add_argument("speed", nargs="?", type=float, default=13.0, help="its command [m/s]")
    chosen = parser.parse_args()
    leg = effective_leg_mass(build_model(load_robot("bp2")))
    print(f"effective mass of a leg: {leg:.2f} kg")
    drops(leg)
    steps(chosen.policy, chosen.speed)
