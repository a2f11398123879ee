"""What the engine does per second on one device, and how exactly: one JSON file.

python benchmarks/engine.py --device cuda:0 --output engine.json
"""

from __future__ import annotations

import argparse
import json
import platform
import tempfile
import time
from datetime import UTC, datetime
from pathlib import Path
from unittest import mock

import torch

from sprintlab.engine import Engine, EngineOptions
from sprintlab.robots import load_robot

STEPS = ((0.001, 20), (0.0005, 40), (0.00025, 80))
"""Time step [s] and substeps of the policy steps that are timed."""
ROBOTS = {"cuda": (8192, 32768, 131072), "cpu": (1024,)}
FIELDS = ("qpos", "qvel", "bristle", "torque", "power", "gear_torque", "foot_force", "leg_distance")
_SECONDS = 0.7


def options(robots: int, timestep: float, substeps: int) -> EngineOptions:
    """The robots of one measurement."""
    return EngineOptions(robots=robots, timestep=timestep, substeps=substeps)


def processor() -> str:
    """What Linux calls the CPU, and how many threads PyTorch would use."""
    lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return f"{names[0] if names else platform.machine()}, {torch.get_num_threads()} threads"


def wait(device: str) -> None:
    """Let the device finish."""
    if device.startswith("cuda"):
        torch.cuda.synchronize(device)


def scatter(engine: Engine, height: float = 0.5) -> None:
    """Robots that differ: poses, velocities, pads and targets, the same for the same number."""
    draw = torch.Generator().manual_seed(3)

    def normal(shape: torch.Size, width: float) -> torch.Tensor:
        return width * torch.randn(shape, generator=draw)

    place = normal(engine.qpos.shape, 0.1)
    place[:, :2] = 0.0
    engine.qpos += place.to(engine.qpos)
    engine.qpos[:, 2] += height - float(engine.robot.standing_height)
    engine.qpos[:, 3:7] /= engine.qpos[:, 3:7].norm(dim=1, keepdim=True)
    engine.qvel += normal(engine.qvel.shape, 1.0).to(engine.qvel)
    engine.target += normal(engine.target.shape, 0.2).to(engine.target)
    n = engine.robots
    stiffness = 40e3 * 4.0 ** torch.rand(n, generator=draw)
    engine.draw_pads(stiffness, 0.2 + 0.4 * torch.rand(n, generator=draw))


def compile_times(device: str) -> dict[str, float]:
    """Seconds until an engine can step: with an empty cache, and with a full one."""
    with tempfile.TemporaryDirectory() as folder, mock.patch.dict("os.environ", XDG_CACHE_HOME=folder):
        times = []
        for _ in range(2):
            started = time.perf_counter()
            Engine(load_robot("bp2"), options(64, 0.001, 20), device).step()
            wait(device)
            times.append(time.perf_counter() - started)
    return {"first [s]": times[0], "cached [s]": times[1]}


def throughput(device: str) -> list[dict[str, float]]:
    """Policy steps per second of every size and time step; robots that run and fall as they like.

    A CPU's seconds are those of its cores at work, so that what else runs there does not count.
    """
    rows, clock = [], time.perf_counter if device.startswith("cuda") else time.process_time
    for timestep, substeps in STEPS:
        for robots in ROBOTS[torch.device(device).type]:
            engine = Engine(load_robot("bp2"), options(robots, timestep, substeps), device)
            scatter(engine)
            engine.step()
            wait(device)
            count, started = 0, clock()
            while clock() - started < _SECONDS:
                for _ in range(10):
                    engine.step()
                wait(device)
                count += 10
            rate = robots * count / (clock() - started)
            rows.append(
                {"timestep [s]": timestep, "substeps": substeps, "robots": robots, "policy steps/s": rate}
            )
            print(rows[-1], flush=True)
    return rows


def run(engine: Engine, steps: int) -> dict[str, torch.Tensor]:
    """Everything after some policy steps, on the host."""
    for _ in range(steps):
        engine.step()
    return {name: getattr(engine, name).detach().cpu().clone() for name in FIELDS}


def bit_equality(device: str) -> dict[str, bool]:
    """Whether two runs, a run split over two batches, and captured launches agree in every bit."""
    n, part = 1024, 373
    robot, chosen = load_robot("bp2"), options(n, 0.001, 20)
    engines = [Engine(robot, chosen, device) for _ in range(3)]
    for engine in engines:
        scatter(engine)
    halves = [Engine(robot, options(count, 0.001, 20), device) for count in (part, n - part)]
    for half, rows in zip(halves, (slice(0, part), slice(part, n)), strict=True):
        for name in ("qpos", "qvel", "target", "parameters"):
            getattr(half, name).copy_(getattr(engines[0], name)[rows])
    captured = run_captured(engines[2], 20, device)
    first, second = (run(engine, 20) for engine in engines[:2])
    one, two = (run(half, 20) for half in halves)
    return {
        "two runs": all(torch.equal(first[name], second[name]) for name in FIELDS),
        "split batches": all(torch.equal(first[name], torch.cat((one[name], two[name]))) for name in FIELDS),
        "captured": all(torch.equal(first[name], captured[name]) for name in FIELDS),
    }


def run_captured(engine: Engine, steps: int, device: str) -> dict[str, torch.Tensor]:
    """As ``run``, from a CUDA graph."""
    if not device.startswith("cuda"):
        return run(engine, steps)
    graph = torch.cuda.CUDAGraph()
    with torch.cuda.graph(graph):
        engine.step()
    for _ in range(steps):
        graph.replay()
    return run(engine, 0)


def against_double(device: str) -> dict[str, dict[str, float]]:
    """Greatest difference from double precision after one policy step, in the air and on the ground."""
    robot, n, result = load_robot("bp2"), 512, {}
    for case, height in (("air", 2.0), ("ground", 0.5)):
        engine = Engine(robot, options(n, 0.001, 20), device)
        reference = Engine(robot, options(n, 0.001, 20), "cpu", double=True)
        scatter(engine, height)
        for name in ("qpos", "qvel", "target", "parameters"):
            getattr(reference, name).copy_(getattr(engine, name))
        ours, theirs = run(engine, 1), run(reference, 1)
        finite = all(bool(torch.isfinite(values).all()) for values in ours.values())
        worst = {name: float((ours[name].double() - theirs[name]).abs().max()) for name in FIELDS}
        result[case] = {"finite": float(finite), **worst}
        print(case, result[case], flush=True)
    return result


def main() -> None:
    """Measure and write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--output", type=Path, required=True)
    arguments = parser.parse_args()
    device = arguments.device
    cuda = device.startswith("cuda")
    result = {
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        "device": torch.cuda.get_device_name(device) if cuda else processor(),
        "torch": torch.__version__,
        "threads": torch.get_num_threads(),
        "compile": compile_times(device),
        "throughput": throughput(device),
        "bit-equal": bit_equality(device),
        "difference from double precision": against_double(device),
    }
    arguments.output.write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")
    print(json.dumps(result["compile"]), json.dumps(result["bit-equal"]), flush=True)


if __name__ == "__main__":
    main()
