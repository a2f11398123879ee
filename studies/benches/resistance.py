"""What a bench tells besides torque: resistance and back-EMF of the D5065 from its drive's power."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from sprintlab.workbench.identification import load_bench
from studies.benches.data import LARGEST_D_CURRENT, part, points, present
from studies.benches.predictions import fitted

MEASURED = (0.0288, 0.0286, 0.0286, 0.0287)
"""The drive's own measurements at rest, in the source's motor_param.csv [ohm]."""


def resistance_rows(folder: Path) -> dict[str, Any]:
    """Resistance, and the torque constant with and without the power in the fit."""
    bench = load_bench(present(folder, "d5065-points.csv"))
    with_power = fitted(
        "d5065", replace(part(bench, np.abs(bench.d_current) <= LARGEST_D_CURRENT), temperature=None)
    )
    resistance = with_power.estimates["stator_resistance"]
    return {
        "fitted": resistance.value,
        "half_width": resistance.half_width,
        "measured_by_the_drive": list(MEASURED),
        "torque_constant_with_power": with_power.torque_constant,
        "torque_constant_of_torque_alone": fitted("d5065", points(folder)).torque_constant,
        "rows_left_out": int(np.sum(np.abs(bench.d_current) > LARGEST_D_CURRENT)),
        "warnings": list(with_power.warnings),
    }
