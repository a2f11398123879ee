"""The numbers of a run: their names, units and keys, the same in every table and every JSON file."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np


class Quantity(NamedTuple):
    """One field of ``TrialMetrics`` as people and programs read it.

    Attributes:
        field: of ``TrialMetrics``.
        key: in JSON files.
        name: in tables that say elsewhere what it means.
        hint: what a table without explanations puts behind the name; may be empty.
        digits: behind the point.
        unit: as text; empty for a ratio.
        meaning: half a sentence.
    """

    field: str
    key: str
    name: str
    hint: str
    digits: int
    unit: str
    meaning: str

    @property
    def label(self) -> str:
        """Name and hint."""
        return f"{self.name} ({self.hint})" if self.hint else self.name


# fmt: off
QUANTITIES = (
    Quantity("held_speed", "held_speed_m_s", "held speed", "last 2 s of the hold", 2, "m/s",
             "mean over the last 2 s of the hold, heading frame"),
    Quantity("hold_acceleration", "hold_acceleration_m_s2", "held speed still rises by", "end of the hold",
             2, "m/s²",
             "mean of the hold's last second minus the second before; steady up to 0.1"),
    Quantity("peak_speed", "peak_speed_m_s", "peak speed", "0.5 s mean", 2, "m/s",
             "best mean over 0.5 s"),
    Quantity("angular_cost", "J_rad2_s", "J", "roll and pitch rates", 2, "rad²/s",
             "integral of roll rate² + pitch rate² over the profile"),
    Quantity("angular_cost_rate", "J_per_second_rad2_s2", "J per second", "of the hold", 2, "rad²/s²",
             "mean of roll rate² + pitch rate² over the hold"),
    Quantity("cost_of_transport", "cost_of_transport", "cost of transport", "", 2, "",
             "power from the bus / (mass g speed), same time"),
    Quantity("electrical_power", "electrical_power_W", "power from the bus", "", 0, "W",
             "all motors, last 2 s of the hold"),
    Quantity("mechanical_power", "mechanical_power_W", "mechanical power", "", 0, "W",
             "delivered to the joints, last 2 s of the hold"),
    Quantity("copper_power", "copper_power_W", "copper loss", "", 0, "W",
             "heat in the windings, last 2 s of the hold"),
    Quantity("stride_frequency", "stride_frequency_Hz", "stride frequency", "", 2, "Hz",
             "last 2 s of the hold"),
    Quantity("stance_time", "stance_s", "stance", "median", 3, "s",
             "median from touchdown to lift-off, last 2 s of the hold"),
    Quantity("mean_duty", "duty", "duty factor", "mean foot", 3, "",
             "share of the time on the ground, last 2 s of the hold"),
    Quantity("lateral_deviation", "lateral_deviation_m", "sideways deviation", "", 2, "m",
             "largest distance from the straight line"),
    Quantity("over_speed_share", "over_speed_share", "time beyond no-load speed", "all joints", 4, "",
             "share of all joints' time in which the drive can only brake"),
)
"""In the order of the tables."""
# fmt: on


def quantity_numbers(value_of: Callable[[str], Any]) -> dict[str, Any]:
    """Every quantity under its JSON key; ``value_of`` gives the value of a field of ``TrialMetrics``."""
    return {quantity.key: value_of(quantity.field) for quantity in QUANTITIES}


def number(value: float, digits: int = 2) -> str:
    """A number as text; a dash where it is not defined."""
    return f"{round(value, digits) + 0.0:.{digits}f}" if np.isfinite(value) else "-"
