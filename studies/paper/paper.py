"""What the paper reports: Table II and the hardware runs, as the yardstick of ours."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class PaperRow:
    """One row of the paper's Table II.

    Attributes:
        label: the paper's name of the method.
        actuator: motor model in training.
        commands: how commands evolve in training.
        max_velocity: [m/s]; ``None`` for the method that collapsed.
        normalized_cost: J over the J of the paper's own method; ``None`` likewise.
    """

    label: str
    actuator: str
    commands: str
    max_velocity: float | None
    normalized_cost: float | None


PAPER_TABLE = {
    "baseline": PaperRow(
        label="baseline",
        actuator="square",
        commands="uniform",
        max_velocity=9.4,
        normalized_cost=0.876,
    ),
    "no-envelope": PaperRow(
        label="without envelope",
        actuator="square",
        commands="adaptive",
        max_velocity=11.0,
        normalized_cost=1.212,
    ),
    "simplified-dc": PaperRow(
        label="simplified DC",
        actuator="v_d = 0",
        commands="adaptive",
        max_velocity=11.7,
        normalized_cost=1.070,
    ),
    "fixed-acceleration": PaperRow(
        label="fixed acceleration",
        actuator="refined",
        commands="fixed acceleration",
        max_velocity=None,
        normalized_cost=None,
    ),
    "uniform-commands": PaperRow(
        label="uniform commands",
        actuator="refined",
        commands="uniform",
        max_velocity=11.0,
        normalized_cost=1.452,
    ),
    "acs": PaperRow(
        label="Ours (the paper's)",
        actuator="refined",
        commands="adaptive",
        max_velocity=12.4,
        normalized_cost=1.000,
    ),
}
"""The six methods in the paper's order."""

REPORTED = (
    ("WildCat (Boston Dynamics)", None, 8.89),
    ("RLvRL (Mini Cheetah)", 5.7, 3.9),
    ("HACL (Go1)", 6.7, 4.1),
    ("Hound", 6.5, 5.9),
    ("Spot (Miller et al. 2025)", None, 5.2),
    ("BP2 (the paper's Ours)", 12.4, 11.65),
)
"""The paper's Table III, as reported there: robot, speed in simulation and outdoors [m/s]."""

REFERENCE_METHOD = "acs"
"""The method whose J is 1."""
