"""Training speed on one device: physics alone, the whole step, and PPO, beside stock mjlab.

    python benchmarks/training_throughput.py --output throughput.json

``ours`` are the steps that we train with, ``ours-4x5`` those of mjlab's task.

Every number is the median of ``--repeats`` samples, each of ``--steps`` policy steps (PPO: two iterations)
between two waits for the device. Ours are measured along one and the same motion: from states that random
actions lead to, put back every few steps, the same actions again, as the whole step (``whole_step``), as
actions, motors and MuJoCo Warp's step (``physics``), and as MuJoCo Warp's step alone, fed with the torques
recorded there (``bare_physics``). Without motors the robots would lie in a heap, which costs less. mjlab's
physics is timed from such states with its last torques. A part that fails leaves its error in the result and
the others go on; the program then ends with 1.
"""

from __future__ import annotations

import argparse
import gc
import itertools
import json
import os
import statistics
import subprocess
import sys
import time
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stdout
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

os.environ.setdefault("MUJOCO_GL", "disabled")

import mujoco_warp
import torch
import warp as wp
from harness import circumstances
from rich.console import Console
from rich.table import Table

from sprintlab.core.files import atomic_write_text
from sprintlab.training.environment.sprint import SprintEnvironment
from sprintlab.training.graphs import suspended_garbage_collection
from sprintlab.training.runs.runner import Runner, device_description
from sprintlab.training.settings import PRECISIONS, SimulationSettings, TrainingSettings

MJLAB_TASK = "Mjlab-Velocity-Flat-Unitree-Go1"
PACKAGES = ("sprintlab", "torch", "warp-lang", "mujoco", "mujoco-warp", "mjlab", "rsl-rl-lib", "numpy")
PARTS = ("ours-4x5", "ours", "mjlab")
RESTORE_EVERY = 5
"""Policy steps (0.1 s) between two restorations of the state, physics alone."""
ITERATIONS = 2
"""PPO iterations a sample."""
WARM_UP_ITERATIONS = 3


@dataclass(frozen=True, kw_only=True)
class Plan:
    """What to measure: environments, device, samples, policy steps a sample, precision, where results go."""

    environments: int
    device: str
    repeats: int
    steps: int
    parts: tuple[str, ...]
    precision: str
    output: Path | None

    def wait(self) -> None:
        """Until the device is idle."""
        if self.device.startswith("cuda"):
            torch.cuda.synchronize(self.device)


Restore = Callable[[], None]


def sample(plan: Plan, seconds: Callable[[], float], steps: int) -> dict[str, Any]:
    """``plan.repeats`` samples of ``seconds()`` for ``steps`` policy steps, as environment steps a second."""
    durations = [seconds() for _ in range(plan.repeats)]
    rates = [steps * plan.environments / duration for duration in durations]
    return {
        "median_steps_per_second": statistics.median(rates),
        "median_milliseconds_per_step": 1e3 * statistics.median(durations) / steps,
        "steps_per_second": rates,
        "policy_steps_per_sample": steps,
    }


def timed(plan: Plan, work: Callable[[], object], times: int) -> float:
    """Seconds [s] for ``times`` calls, device included."""
    plan.wait()
    started = time.perf_counter()
    for _ in range(times):
        work()
    plan.wait()
    return time.perf_counter() - started


def measure_pieces(plan: Plan, step: Callable[[int], object], restore: Restore) -> dict[str, Any]:
    """``step(0)``, ``step(1)``...; every ``RESTORE_EVERY`` steps the state is put back, outside the clock."""
    pieces = max(1, plan.steps // RESTORE_EVERY)

    def piece() -> float:
        restore()
        count = itertools.count()
        return timed(plan, lambda: step(next(count)), RESTORE_EVERY)

    piece()
    return sample(plan, lambda: sum(piece() for _ in range(pieces)), pieces * RESTORE_EVERY)


def random_actions(plan: Plan, joints: int) -> list[torch.Tensor]:
    """Uniform in [-1, 1], a few, to be taken in turn."""
    return [2 * torch.rand(plan.environments, joints, device=plan.device) - 1 for _ in range(8)]


def measure_step(plan: Plan, step: Callable[[torch.Tensor], object], joints: int) -> dict[str, Any]:
    """Whole environment steps with random actions."""
    actions = itertools.cycle(random_actions(plan, joints))
    timed(plan, lambda: step(next(actions)), plan.steps)
    return sample(plan, lambda: timed(plan, lambda: step(next(actions)), plan.steps), plan.steps)


def measure_ppo(plan: Plan, iterate: Callable[[int], object], rollout: int) -> dict[str, Any]:
    """``iterate(k)`` runs ``k`` iterations of rollout and update."""
    iterate(WARM_UP_ITERATIONS)
    return sample(plan, lambda: timed(plan, lambda: iterate(ITERATIONS), 1), ITERATIONS * rollout)


def snapshot(buffers: list[Any]) -> Restore:
    """Remember the buffers' contents; the result writes them back."""
    saved = [buffer[...].clone() for buffer in buffers]

    def restore() -> None:
        for buffer, value in zip(buffers, saved, strict=True):
            buffer[...] = value

    return restore


def bare_physics(environment: SprintEnvironment, actions: list[torch.Tensor]) -> Callable[[int], None]:
    """Step ``k`` of the motion that ``actions`` make from the present state, with nothing of ours in it.

    Runs that motion once and records every torque on the way.
    """
    simulation, substeps = environment.simulation, environment.settings.simulation.substeps
    torques = [[simulation.ctrl.clone() for _ in range(substeps)] for _ in range(RESTORE_EVERY)]
    device = wp.get_device(simulation.device)
    with suspended_garbage_collection(), wp.ScopedDevice(device):
        for step, recorded in enumerate(torques):
            environment.write_action(actions[step])
            for substep, torque in enumerate(recorded):
                simulation.actuate(substep)
                torque.copy_(simulation.ctrl)
                mujoco_warp.step(simulation.model, simulation.data)
        wp.synchronize_device(device)

        def replay(step: int) -> None:
            for torque in torques[step]:
                wp.copy(simulation.data.ctrl, wp.from_torch(torque))
                mujoco_warp.step(simulation.model, simulation.data)

        if not device.is_cuda:
            return replay
        graphs = [captured_by_warp(lambda step=step: replay(step)) for step in range(RESTORE_EVERY)]
    return lambda step: wp.capture_launch(graphs[step])


def captured_by_warp(work: Callable[[], None]) -> Any:
    """A graph of launches on the present device."""
    with wp.ScopedCapture() as capture:
        work()
    return capture.graph


def measure_ours(plan: Plan, physics: SimulationSettings) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield each measurement of ours as it is ready."""
    defaults = TrainingSettings()
    settings = replace(
        defaults,
        simulation=replace(physics, environments=plan.environments),
        ppo=replace(defaults.ppo, precision=plan.precision),
    )
    yield "settings", {"simulation": asdict(settings.simulation), "ppo": asdict(settings.ppo)}
    runner = Runner(settings, plan.device, "benchmark")
    environment = runner.environment
    with torch.inference_mode():
        actions = random_actions(plan, environment.num_actions)
        for step in range(plan.steps):
            environment.step(actions[step % len(actions)])
        restore = snapshot(list(environment.state().values()))
        yield "whole_step", measure_pieces(plan, lambda step: environment.step(actions[step]), restore)

        def physics_step(step: int) -> None:
            environment.write_action(actions[step])
            environment.simulation.step()

        yield "physics", measure_pieces(plan, physics_step, restore)
        restore()
        replay = bare_physics(environment, actions)
        yield "bare_physics", measure_pieces(plan, replay, restore)
        restore()

    def iterate(count: int) -> None:
        for _ in range(count):
            runner.iterate()

    yield "ppo", measure_ppo(plan, iterate, settings.ppo.steps)


def measure_mjlab(plan: Plan) -> Iterator[tuple[str, dict[str, Any]]]:
    """The same of mjlab's own Go1 task, built as its training script does; nothing is logged or saved."""
    # Only this part needs mjlab, which is no dependency of ours.
    import mjlab.tasks  # noqa: F401  (registers the tasks)
    from mjlab.envs import ManagerBasedRlEnv
    from mjlab.rl import MjlabOnPolicyRunner, RslRlVecEnvWrapper
    from mjlab.tasks.registry import load_env_cfg, load_rl_cfg, load_runner_cls
    from mjlab.utils.torch import configure_torch_backends

    configure_torch_backends()
    settings, agent = load_env_cfg(MJLAB_TASK), load_rl_cfg(MJLAB_TASK)
    settings.scene.num_envs, settings.seed = plan.environments, 0
    agent.logger = "tensorboard"
    environment = RslRlVecEnvWrapper(
        ManagerBasedRlEnv(cfg=settings, device=plan.device), clip_actions=agent.clip_actions
    )
    runner_class = load_runner_cls(MJLAB_TASK) or MjlabOnPolicyRunner
    runner = runner_class(environment, asdict(agent), None, plan.device)
    simulation, substeps = environment.unwrapped.sim, settings.decimation
    yield (
        "settings",
        {
            "task": MJLAB_TASK,
            "timestep": settings.sim.mujoco.timestep,
            "substeps": substeps,
            "ppo": {"steps": agent.num_steps_per_env, "algorithm": asdict(agent.algorithm)},
        },
    )
    with torch.inference_mode():
        yield "whole_step", measure_step(plan, environment.step, environment.num_actions)
        data = simulation.data
        restore = snapshot([data.qpos, data.qvel, data.qacc_warmstart])

        def physics(step: int) -> None:
            for _ in range(substeps):
                simulation.step()

        yield "bare_physics", measure_pieces(plan, physics, restore)
        restore()
    yield "ppo", measure_ppo(plan, runner.learn, agent.num_steps_per_env)
    environment.close()


def part(plan: Plan, name: str) -> Iterator[tuple[str, dict[str, Any]]]:
    """The measurements of a part."""
    if name == "mjlab":
        return measure_mjlab(plan)
    if name == "ours-4x5":
        # mjlab's steps, for comparison only: at 5 ms the knee spring would ring itself apart.
        coarse = SimulationSettings(timestep=0.005, substeps=4, knee_spring=False)
        return measure_ours(plan, coarse)
    return measure_ours(plan, SimulationSettings())


@contextmanager
def recorded_errors(result: dict[str, Any]) -> Iterator[None]:
    """Put what goes wrong into ``result["error"]``: the machine may be lent for one run only."""
    try:
        yield
    except Exception:
        result["error"] = traceback.format_exc()
        print(result["error"], file=sys.stderr)


def with_ratios(parts: dict[str, dict[str, Any]]) -> dict[str, float]:
    """Rates over rates: inside a part to physics alone, and ours to mjlab's."""

    def rate(name: str, measurement: str) -> float | None:
        return parts.get(name, {}).get(measurement, {}).get("median_steps_per_second")

    ratios: dict[str, float] = {}
    for name in parts:
        for whole, base in itertools.product(("whole_step", "ppo"), ("physics", "bare_physics")):
            if (ours := rate(name, whole)) and (alone := rate(name, base)):
                ratios[f"{name}: {whole} / {base}, steps per second"] = ours / alone
        for measurement in ("whole_step", "ppo"):
            mine, theirs = rate(name, measurement), rate("mjlab", measurement)
            if mine and theirs and name != "mjlab":
                ratios[f"{name} / mjlab: {measurement}, steps per second"] = mine / theirs
    return ratios


def driver_version() -> str | None:
    """Of the NVIDIA driver; None without one."""
    query = ["nvidia-smi", "--query-gpu=driver_version", "--format=csv,noheader"]
    try:
        return subprocess.run(query, capture_output=True, text=True, check=True).stdout.strip()
    except (OSError, subprocess.CalledProcessError):
        return None


def description(plan: Plan) -> dict[str, Any]:
    """Everything that the numbers depend on."""
    return {
        "device": device_description(plan.device),
        "driver": driver_version(),
        "cuda": torch.version.cuda,
        **circumstances(PACKAGES),
        "environments": plan.environments,
        "repeats": plan.repeats,
        "ppo_iterations": {"warm_up": WARM_UP_ITERATIONS, "a_sample": ITERATIONS},
    }


def measure(plan: Plan) -> dict[str, Any]:
    """All parts; the output is rewritten after every measurement, so that a cut run leaves what it has."""
    result: dict[str, Any] = {**description(plan), "parts": {}, "ratios": {}}
    for name in plan.parts:
        measured: dict[str, Any] = result["parts"].setdefault(name, {})
        with recorded_errors(measured):
            for measurement, values in part(plan, name):
                measured[measurement] = values
                measured["matmul_tf32"] = (
                    getattr(torch.backends.cuda.matmul, "fp32_precision", None) == "tf32"
                )
                print(f"{name} {measurement}: {values.get('median_steps_per_second', '')}", file=sys.stderr)
                result["ratios"] = with_ratios(result["parts"])
                write(plan, result)
        write(plan, result)
        gc.collect()
        torch.cuda.empty_cache()
    return result


def write(plan: Plan, result: dict[str, Any]) -> None:
    """To the output, if there is one."""
    if plan.output is not None:
        atomic_write_text(plan.output, json.dumps(result, indent=2) + "\n")


def show(result: dict[str, Any]) -> None:
    """Tables of the medians and of the ratios."""
    table = Table("part", "measurement", "steps/s", "ms a step", title=result["device"])
    for name, measured in result["parts"].items():
        for measurement, values in measured.items():
            if isinstance(values, dict) and "median_steps_per_second" in values:
                speed, duration = values["median_steps_per_second"], values["median_milliseconds_per_step"]
                table.add_row(name, measurement, f"{speed:,.0f}", f"{duration:.3f}")
        if "error" in measured:
            table.add_row(name, "failed", "", "")
    ratios = Table("ratio", "value")
    for name, value in result["ratios"].items():
        ratios.add_row(name, f"{value:.3f}")
    console = Console()
    console.print(table)
    console.print(ratios)


def arguments() -> tuple[Plan, bool]:
    """From the command line: the plan, and whether to print JSON instead of tables."""
    parser = argparse.ArgumentParser(description="Training speed of sprintlab and of mjlab on one device.")
    parser.add_argument("--environments", type=int, default=8192)
    parser.add_argument("--device", default="cuda:0")
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--steps", type=int, default=50, help="policy steps a sample")
    parser.add_argument("--parts", default=",".join(PARTS), help="comma-separated: %(default)s")
    parser.add_argument("--precision", choices=PRECISIONS, default="tf32", help="of our networks")
    parser.add_argument("--output", type=Path, help="JSON file")
    parser.add_argument("--json", action="store_true", help="print JSON instead of tables")
    given = parser.parse_args()
    parts = tuple(given.parts.split(","))
    if unknown := set(parts) - set(PARTS):
        parser.error(f"--parts: unknown {sorted(unknown)}, allowed: {', '.join(PARTS)}")
    if min(given.environments, given.repeats, given.steps) < 1:
        parser.error("--environments, --repeats and --steps must be at least 1")
    plan = Plan(
        environments=given.environments,
        device=given.device,
        repeats=given.repeats,
        steps=given.steps,
        parts=parts,
        precision=given.precision,
        output=given.output,
    )
    return plan, given.json


def main() -> int:
    """Measure and report; 1 if a part failed."""
    plan, as_json = arguments()
    with redirect_stdout(sys.stderr):  # the libraries describe themselves at length
        result = measure(plan)
    if as_json:
        print(json.dumps(result, indent=2))
    else:
        show(result)
    return int(any("error" in measured for measured in result["parts"].values()))


if __name__ == "__main__":
    sys.exit(main())
