"""Write the synthetic benches beside this file: no hardware was involved, the truth is in MOTOR.

Run: python examples/motors/make_bench.py

Operating points lie on a grid of speeds and currents inside the voltage limit, then on the limit itself,
where the inverter gives all its voltage (column ``limited``). Sensors add Gaussian noise; the generator is
NumPy's default_rng with SEED, so that the files come out the same every time.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from sprintlab.core.files import atomic_write_text
from sprintlab.motors import PmsmParameters, phase_voltage_limit, save_motor, torque_limits

SEED = 20261121
MOTOR = PmsmParameters(
    pole_pairs=21,
    stator_resistance=0.158,
    q_axis_inductance=84e-6,
    flux_linkage=6.08e-3,
    peak_torque=12.0,
    saturation=0.15,
    rotor_inertia=5.548e-4,
)
BUS_VOLTAGE = 60.0  # V
COULOMB_FRICTION = 0.08  # N m
VISCOUS_FRICTION = 4e-4  # N m s/rad
TORQUE_NOISE = 0.03  # N m, standard deviation
VOLTAGE_NOISE = 0.05  # V
CURRENT_NOISE = 0.02  # A
HEADER = "speed [rad/s],iq [A],torque [N m],vq [V],vd [V],bus_voltage [V],temperature [degC],limited"


def operating_points() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Speeds [rad/s], currents [A] and whether the inverter gives all its voltage, one a row."""
    peak_current = MOTOR.peak_torque / MOTOR.torque_constant
    grid = np.meshgrid(np.linspace(10.0, 200.0, 8), np.linspace(-1.0, 1.0, 9) * peak_current, indexing="ij")
    speed, current = (values.ravel() for values in grid)
    lower, upper = (limit / MOTOR.torque_constant for limit in torque_limits(MOTOR, speed, BUS_VOLTAGE))
    inside = (current > lower) & (current < upper)
    edge = np.linspace(160.0, 250.0, 12)
    on_edge = torque_limits(MOTOR, edge, BUS_VOLTAGE)[1] / MOTOR.torque_constant
    limited = on_edge < 0.999 * peak_current
    return (
        np.concatenate((speed[inside], edge[limited])),
        np.concatenate((current[inside], on_edge[limited])),
        np.concatenate((np.zeros(int(inside.sum())), np.ones(int(limited.sum())))),
    )


def bench_table(random: np.random.Generator) -> str:
    """A bench of every column, as CSV."""
    speed, current, limited = operating_points()
    temperature = 25.0 + 40.0 * (current / np.max(np.abs(current))) ** 2
    resistance = MOTOR.stator_resistance * (1.0 + 0.00393 * (temperature - 20.0))
    torque = shaft_torque(current) - COULOMB_FRICTION * np.sign(speed) - VISCOUS_FRICTION * speed
    electrical = MOTOR.pole_pairs * speed
    v_q = resistance * current + electrical * MOTOR.flux_linkage
    v_d = -electrical * MOTOR.q_axis_inductance * current
    # On the limit a hot winding needs more than 60 V give: so the bench's supply is set to just suffice.
    bus = np.where(limited > 0, np.hypot(v_q, v_d) / phase_voltage_limit(1.0), BUS_VOLTAGE)
    columns = (
        speed,
        current + random.normal(0.0, CURRENT_NOISE, len(speed)),
        torque + random.normal(0.0, TORQUE_NOISE, len(speed)),
        v_q + random.normal(0.0, VOLTAGE_NOISE, len(speed)),
        v_d + random.normal(0.0, VOLTAGE_NOISE, len(speed)),
        bus,
        temperature,
        limited,
    )
    rows = (",".join(f"{value:.5g}" for value in row) for row in zip(*columns, strict=True))
    return "\n".join((remark(), HEADER, *rows)) + "\n"


def torque_current_table(random: np.random.Generator) -> str:
    """A torque-current table at standstill, as CSV."""
    current = np.linspace(2.0, 62.0, 25)
    torque = shaft_torque(current) + random.normal(0.0, TORQUE_NOISE, len(current))
    rows = (f"{i:.4g},{tau:.5g}" for i, tau in zip(current, torque, strict=True))
    return "\n".join((remark(), "iq [A],torque [N m]", *rows)) + "\n"


def shaft_torque(current: np.ndarray) -> np.ndarray:
    """Torque with saturation and without friction [N m]."""
    ideal = MOTOR.torque_constant * current
    return ideal * (1.0 - MOTOR.saturation * np.abs(ideal) / MOTOR.peak_torque)


def remark() -> str:
    """The first line of every file."""
    return f"# synthetic: examples/motors/make_bench.py, seed {SEED}; no hardware was involved"


def main() -> None:
    """Write the three files."""
    folder = Path(__file__).parent
    random = np.random.default_rng(SEED)
    atomic_write_text(folder / "bench.csv", bench_table(random))
    atomic_write_text(folder / "torque-current.csv", torque_current_table(random))
    save_motor(MOTOR, folder / "bench-motor.toml")
    print(f"peak current {MOTOR.peak_torque / MOTOR.torque_constant:.4g} A")


if __name__ == "__main__":
    main()
