"""What ``sprintlab evaluate --clock-check`` prints and writes."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from sprintlab.api.tables import plain_table

if TYPE_CHECKING:
    from rich.table import Table

    from sprintlab.evaluation.clock import ClockCheck

NOTE = (
    "Strides: medians over the trials that completed. Locked: a stride takes a whole number of policy steps, "
    "within 0.02."
)


def clock_numbers(check: ClockCheck) -> dict[str, Any]:
    """JSON-ready numbers; what is not defined becomes null."""
    from sprintlab.core.json_values import json_ready

    numbers = {
        "top_speed_command_m_s": check.top_speed,
        "clocks": [
            {
                "policy_rate_Hz": item.clock.rate,
                "period_jitter": item.clock.jitter,
                "trials": item.trials,
                "completed": item.completed,
                "held_speed_m_s": item.held_speed,
                "stride_frequency_Hz": item.stride_frequency,
                "policy_steps_per_stride": item.stride_steps,
                "locked": item.locked,
            }
            for item in check.clocks
        ],
        "followed_share": check.followed,
        "greatest_loss_of_speed": check.greatest_loss,
    }
    return json_ready(numbers)


def clock_table(check: ClockCheck) -> Table:
    """One row a clock."""
    from sprintlab.evaluation.quantities import number

    columns = ("policy clock", "completed", "held [m/s]", "stride [Hz]", "policy steps a stride", "locked")
    title = f"Other policy clocks at {check.top_speed:g} m/s, raw"
    table = plain_table(title, *columns, numbers=columns[1:5])
    for item in check.clocks:
        table.add_row(
            str(item.clock),
            f"{item.completed} of {item.trials}",
            number(item.held_speed),
            number(item.stride_frequency),
            number(item.stride_steps),
            "yes" if item.locked else "no",
        )
    return table


def clock_verdict(check: ClockCheck) -> str:
    """What the table says, in one sentence."""
    followed, loss = check.followed, check.greatest_loss
    stride = "no stride at two rates"
    if math.isfinite(followed):
        stride = f"the stride frequency follows {100 * followed:.0f} % of a change of the clock's rate"
    lost = "trials fell with another clock" if any(x.completed < x.trials for x in check.clocks[1:]) else ""
    cost = f"the worst clock costs {100 * loss:.1f} % of the held speed" if math.isfinite(loss) else ""
    return "; ".join(part for part in (stride, cost, lost) if part)
