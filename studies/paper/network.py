"""``python -m studies.paper network``: actuator networks fitted to a simulated bench of a robot's drives."""

from __future__ import annotations

import io
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import tyro

from sprintlab.cli.output import plain_table, print_json, progress_bar, stdout_console
from sprintlab.core.checks import check_range

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from sprintlab.robots import RobotDescription

    FloatArray = NDArray[np.float64]

TEST_POINTS = 20_000
_BATCH = 1024


@dataclass(frozen=True, kw_only=True)
class Network:
    """Drive a robot's motors on a simulated dynamometer and fit one small network to each kind of drive.

    The bench holds the joint at random speeds, up to 1.3 times the no-load speed, asks for random torques, up
    to twice the peak, and reads a noisy torque. Motor law, gear and bus are the plant's (refined model, cold,
    nominal bus); the network knows none of them.

    Attributes:
        robot: a robot's name or folder.
        output: file of the networks.
        points: bench points a kind of drive.
        epochs: passes over them.
        noise: standard deviation of the torque sensor, in shares of the peak joint torque.
        seed: of points, noise and first weights.
        json: print JSON only.
    """

    robot: str = "bp2"
    output: Path = Path("studies/paper/actuator_network.npz")
    points: int = 30_000
    epochs: int = 200
    noise: float = 0.01
    seed: int = 0
    json: tyro.conf.FlagCreatePairsOff[bool] = False

    def run(self) -> int:
        """Measure, fit, write, print.

        Raises:
            SprintlabError: the robot or a number is refused, or the disk refuses.
        """
        check_range("points", self.points, _BATCH, 10**7)
        check_range("epochs", self.epochs, 1, 10_000)
        check_range("noise", self.noise, 0.0, 1.0)
        from sprintlab.core.files import atomic_write_bytes, check_writable_file
        from sprintlab.robots import load_robot
        from sprintlab.training.environment.actuator_network import read_networks

        check_writable_file(self.output)
        robot = load_robot(self.robot)
        with progress_bar(quiet=self.json) as report:
            arrays = fit(robot, self, report)
        stream = io.BytesIO()
        np.savez_compressed(stream, **arrays)
        atomic_write_bytes(self.output, stream.getvalue())
        errors = fit_errors(robot, read_networks(self.output, robot), self.seed + 1)
        if self.json:
            print_json({"file": str(self.output), "joints": errors})
            return 0
        table = plain_table(
            f"{self.output}", "joint", "rms error", "worst", "of peak", numbers=("rms error",)
        )
        for name, row in errors.items():
            rms, worst = row["rms_error_N_m"], row["worst_error_N_m"]
            table.add_row(name, f"{rms:.2f} N m", f"{worst:.1f} N m", f"{100 * row['rms_share']:.2f} %")
        stdout_console().print(table)
        return 0


def drive_kinds(robot: RobotDescription) -> NDArray[np.int64]:
    """Number of the kind of drive of every joint ``(joints,)``: equal motors and gears are one kind."""
    parts = [getattr(part, item.name) for part in (robot.motors, robot.gear) for item in fields(part)]
    rows = np.stack(
        [np.broadcast_to(np.asarray(part, dtype=float), len(robot.joint_names)) for part in parts]
    )
    return np.unique(rows.T, axis=0, return_inverse=True)[1].reshape(-1)


def bench(
    robot: RobotDescription, points: int, noise: float, seed: int
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Wanted torque [N m], velocity [rad/s] and measured torque [N m] of every joint ``(points, joints)``."""
    from sprintlab.motors import PreparedDrive
    from sprintlab.training.environment.actuator_network import SPEED_REACH, TORQUE_REACH, drive_scales

    random = np.random.default_rng(seed)
    peak, no_load = drive_scales(robot)
    shape = (points, len(peak))
    wanted = random.uniform(-TORQUE_REACH, TORQUE_REACH, shape) * peak
    velocity = random.uniform(-SPEED_REACH, SPEED_REACH, shape) * no_load
    given = np.asarray(PreparedDrive(robot.motors, robot.gear, robot.bus_voltage)(wanted, velocity).torque)
    return wanted, velocity, given + noise * peak * random.standard_normal(shape)


def fit(robot: RobotDescription, options: Network, report: Any) -> dict[str, Any]:
    """Networks of all kinds of drive, fitted at once by Adam: the arrays of a network file."""
    import torch

    from sprintlab.training.environment.actuator_network import WIDTH, drive_scales

    kinds = drive_kinds(robot)
    first = [int(np.flatnonzero(kinds == kind)[0]) for kind in range(kinds.max() + 1)]
    peak, no_load = drive_scales(robot)
    measured = bench(robot, options.points, options.noise, options.seed)
    wanted, velocity, given = (
        torch.tensor((values / scale)[:, first].T, dtype=torch.float32)
        for values, scale in zip(measured, (peak, no_load, peak), strict=True)
    )
    inputs = torch.stack((wanted, velocity), -1)  # (kinds, points, 2)
    torch.manual_seed(options.seed)
    torch.set_num_threads(1)  # matrices of 32 rows: more threads only wait for each other
    count = len(first)
    weights = {
        "input_weight": 1.5 * torch.randn(count, WIDTH, 2),
        "input_bias": torch.randn(count, WIDTH),
        "hidden_weight": torch.randn(count, WIDTH, WIDTH) * WIDTH**-0.5,
        "hidden_bias": torch.zeros(count, WIDTH),
        "output_weight": torch.randn(count, WIDTH) * WIDTH**-0.5,
        "output_bias": torch.zeros(count),
    }
    for value in weights.values():
        value.requires_grad_()
    optimizer = torch.optim.Adam(weights.values(), lr=5e-3)
    decay = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, options.epochs)
    for epoch in range(options.epochs):
        report("fitting", epoch / options.epochs)
        for rows in torch.randperm(options.points).split(_BATCH):
            optimizer.zero_grad()
            (outputs(weights, inputs[:, rows]) - given[:, rows]).square().mean().backward()
            optimizer.step()
        decay.step()
    fitted = {name: value.detach().numpy() for name, value in weights.items()}
    return fitted | {"peak_torque": peak[first], "no_load_speed": no_load[first], "kind": kinds}


def outputs(weights: dict[str, Any], inputs: Any) -> Any:
    """Shares of the peak torque ``(kinds, n)`` for inputs ``(kinds, n, 2)``, in PyTorch."""
    from torch.nn.functional import softsign

    layer = softsign(inputs @ weights["input_weight"].mT + weights["input_bias"][:, None])
    layer = softsign(layer @ weights["hidden_weight"].mT + weights["hidden_bias"][:, None])
    return (layer * weights["output_weight"][:, None]).sum(-1) + weights["output_bias"][:, None]


def fit_errors(robot: RobotDescription, networks: Any, seed: int) -> dict[str, dict[str, float]]:
    """Errors against the noise-free drive at new points, one row a joint of the first leg."""
    from sprintlab.training.environment.actuator_network import drive_scales, network_torque

    wanted, velocity, given = bench(robot, TEST_POINTS, 0.0, seed)
    error = network_torque(networks, wanted, velocity) - given
    peak = drive_scales(robot)[0]
    return {
        robot.joint_names[joint]: {
            "rms_error_N_m": float(np.sqrt(np.mean(error[:, joint] ** 2))),
            "worst_error_N_m": float(np.abs(error[:, joint]).max()),
            "rms_share": float(np.sqrt(np.mean(error[:, joint] ** 2)) / peak[joint]),
        }
        for joint in range(3)
    }
