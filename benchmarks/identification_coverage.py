"""How often the 95 % intervals of ``sprintlab motor identify`` hold the truth, on benches of random motors.

    python benchmarks/identification_coverage.py --benches 200

Each bench is synthetic: 80 random operating points (20 in ``few rows``), a quarter of them on the voltage
limit, with noise of 0.3 % of each sensor's range. Where a case names something that the model lacks, the
intervals cannot hold; what counts then is that a warning says so.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from rich.console import Console
from rich.progress import track
from rich.table import Table

from sprintlab.core.checks import check_range
from sprintlab.core.errors import SprintlabError
from sprintlab.motors import PmsmParameters, no_load_speed, phase_voltage_limit, torque_limits
from sprintlab.workbench.identification import Bench, Identification, identify

BUS = 60.0  # V
UTILIZATION = 0.95
NOISE = 3e-3  # of a sensor's range


@dataclass(frozen=True, kw_only=True)
class Case:
    """What a bench is like.

    Attributes:
        rows: operating points.
        proportional: noise that grows with the reading, as a share of it.
        current_noise: of the current sensor, as a share of the peak current.
        outliers: share of rows whose torque is anything.
        flux_drift: relative change of the flux per kelvin.
        drag: torque with the square of the speed, at the no-load speed, as a share of the peak torque.
        voltages: whether v_q and v_d were measured.
        temperatures: whether the winding's temperature was measured.
    """

    rows: int = 80
    proportional: float = 0.0
    current_noise: float = 0.0
    outliers: float = 0.0
    flux_drift: float = 0.0
    drag: float = 0.0
    voltages: bool = True
    temperatures: bool = True


CASES = {
    "as the model says": Case(),
    "few rows": Case(rows=20),
    "noise grows with the reading": Case(proportional=0.01),
    "noisy current": Case(current_noise=0.01),
    "one torque in twenty wrong": Case(outliers=0.05),
    "warm magnets": Case(flux_drift=-0.0011),
    "no voltages": Case(voltages=False),
    "no temperatures (the model lacks them)": Case(temperatures=False),
    "drag (the model lacks it)": Case(drag=0.03),
}


def drawn_motor(random: np.random.Generator) -> PmsmParameters:
    """A motor of a legged robot's size; one in five is not saturated."""
    pairs, peak = int(random.integers(4, 25)), random.uniform(5.0, 80.0)
    flux = 0.1 / pairs * random.uniform(0.5, 2.0)
    return PmsmParameters(
        pole_pairs=pairs,
        stator_resistance=random.uniform(0.05, 0.4) * phase_voltage_limit(BUS) / peak,
        q_axis_inductance=random.uniform(0.1, 0.9) * flux / peak,
        flux_linkage=flux,
        peak_torque=1.5 * pairs * flux * peak,
        saturation=random.choice([0.0, *random.uniform(0.0, 0.3, 4)]),
        rotor_inertia=1e-4,
    )


def true_values(motor: PmsmParameters, case: Case) -> dict[str, float]:
    """What the fit should find; friction is a hundredth of the peak torque each."""
    return {
        "stator_resistance": motor.stator_resistance,
        "q_axis_inductance": motor.q_axis_inductance,
        "flux_linkage": motor.flux_linkage,
        "flux_drift": case.flux_drift,
        "saturation": motor.saturation,
        "coulomb_friction": 0.01 * motor.peak_torque,
        "viscous_friction": 0.01 * motor.peak_torque / float(no_load_speed(motor, BUS)),
        "voltage_utilization": UTILIZATION,
    }


def make_bench(motor: PmsmParameters, case: Case, random: np.random.Generator) -> Bench:
    """Random operating points in all four quadrants, as imperfect sensors see them."""
    truth, count, top = true_values(motor, case), case.rows, float(no_load_speed(motor, BUS))
    peak = motor.peak_torque / motor.torque_constant
    speed = random.uniform(0.03, 1.05, count) * top * random.choice([-1.0, 1.0], count)
    lower, upper = (limit / motor.torque_constant for limit in torque_limits(motor, speed, BUS))
    current = 0.97 * random.uniform(lower, upper)
    rise = 5.0 + 40.0 * (current / peak) ** 2 * random.uniform(0.5, 1.0, count)
    flux = motor.flux_linkage * (1.0 + case.flux_drift * rise)
    electrical = motor.pole_pairs * speed
    v_q = motor.stator_resistance * (1.0 + 0.00393 * rise) * current + electrical * flux
    v_d = -electrical * motor.q_axis_inductance * current
    torque = 1.5 * motor.pole_pairs * flux * current * (1.0 - motor.saturation * np.abs(current) / peak)
    torque -= truth["coulomb_friction"] * np.sign(speed) + truth["viscous_friction"] * speed
    torque -= case.drag * motor.peak_torque * np.sign(speed) * (speed / top) ** 2
    limited = random.random(count) < 0.25
    bus = np.where(limited, np.hypot(v_q, v_d) / phase_voltage_limit(1.0, UTILIZATION), BUS)

    def sensed(values: Any) -> Any:
        spread = NOISE * np.max(np.abs(values)) + case.proportional * np.abs(values)
        return values + random.normal(0.0, 1.0, count) * spread

    wrong = random.random(count) < case.outliers
    anything = random.uniform(-1.0, 1.0, count) * motor.peak_torque
    return Bench(
        current=current + random.normal(0.0, 1.0, count) * case.current_noise * peak,
        torque=np.where(wrong, anything, sensed(torque)),
        speed=speed,
        d_current=np.zeros(count),
        q_voltage=sensed(v_q) if case.voltages else None,
        d_voltage=sensed(v_d) if case.voltages else None,
        bus_voltage=bus + random.normal(0.0, 0.05, count),
        temperature=20.0 + rise if case.temperatures else None,
        limited=limited,
        lines=np.arange(count) + 2,
    )


def held(found: Identification, truth: dict[str, float]) -> Iterator[tuple[str, bool]]:
    """Each determined parameter, and whether its interval holds the truth."""
    for name, value in truth.items():
        estimate = found.estimates[name]
        if estimate.determined and estimate.value is not None and estimate.half_width is not None:
            yield name, abs(estimate.value - value) <= estimate.half_width


def measure(case: Case, benches: int) -> dict[str, float]:
    """Intervals, the share that holds the truth, and the share of benches whose fit names a lack."""
    intervals, inside, warned = 0, 0, 0
    for seed in range(benches):
        random = np.random.default_rng(seed)
        motor = drawn_motor(random)
        bench = make_bench(motor, case, random)
        peak = motor.peak_torque / motor.torque_constant
        found = identify(bench, pole_pairs=int(motor.pole_pairs), peak_current=peak)
        results = [good for _, good in held(found, true_values(motor, case))]
        intervals, inside = intervals + len(results), inside + sum(results)
        warned += any("lacks" in text or "no temperature" in text for text in found.warnings)
    return {"intervals": intervals, "inside": inside / intervals, "warned": warned / benches}


def main() -> int:
    """Measure and print; 2 where an argument is refused."""
    parser = argparse.ArgumentParser(description="How often 95 % intervals hold the truth.")
    parser.add_argument("--benches", type=int, default=200, help="random motors a case")
    parser.add_argument("--json", action="store_true", help="print JSON only")
    chosen = parser.parse_args()
    try:
        check_range("benches", chosen.benches, 1, 10**5)
    except SprintlabError as error:
        print(f"identification_coverage: {error}", file=sys.stderr)
        return 2
    names = track(CASES, description="fitting", console=Console(stderr=True), transient=True)
    result = {name: measure(CASES[name], chosen.benches) for name in names}
    if chosen.json:
        print(json.dumps(result, indent=2))
        return 0
    table = Table("bench", "intervals", "hold the truth", "fits that name a lack")
    for name, row in result.items():
        table.add_row(name, str(row["intervals"]), f"{row['inside']:.1%}", f"{row['warned']:.0%}")
    Console(highlight=False).print(table)
    return 0


if __name__ == "__main__":
    sys.exit(main())
