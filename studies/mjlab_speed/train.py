"""Training: mjlab's Go1 task on three actuators, several runs at a time, each resumed where it stopped."""

from __future__ import annotations

import argparse
import itertools
import os
import subprocess
import sys
import time
import zipfile
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from sprintlab.robots import robot_motors

ACTUATORS = ("stock", "data-sheet", "refined")
STAGES = ((0.0, 1.5), (0.1, 2.0), (0.2, 3.0), (0.35, 4.0), (0.5, 5.0), (0.65, 6.0))
"""Share of the training from which commands go up to a speed [m/s]."""
STALL_TORQUE = {"hip": 23.7, "thigh": 23.7, "calf": 35.55}
"""Published for the Go1's joints [N m]."""
NO_LOAD_SPEED = {"hip": 30.1, "thigh": 30.1, "calf": 20.06}
"""Published [rad/s]."""
NOMINAL_VOLTAGE = 24.0
STEPS_PER_ITERATION = 24
"""Policy steps per robot between two updates in mjlab's task."""
CHUNK = 25  # iterations between two checkpoints
POLICY = "policy.npz"


def actuators(law: str) -> tuple[Any, ...]:
    """mjlab's actuator groups for hips with thighs and for calves, same gains under each law."""
    from mjlab.actuator.builtin_actuator import BuiltinDcMotorActuatorCfg, DcMotorDatasheetParams
    from mjlab.asset_zoo.robots.unitree_go1 import go1_constants as go1

    from sprintlab.integrations.mjlab import PmsmActuatorCfg

    def group(stock: Any, kind: str) -> Any:
        own = {"target_names_expr": stock.target_names_expr, "armature": stock.armature}
        if law == "stock":
            return stock
        if law == "refined":
            gains = {"stiffness": stock.stiffness, "damping": stock.damping}
            return PmsmActuatorCfg(**own, **gains, motors=robot_motors("go1"))
        # mjlab's gains of this actuator are volts: K / R of the sheet's motor turns them into torque, and its
        # back-EMF is a damping of K^2 / R of its own.
        constant = NOMINAL_VOLTAGE / NO_LOAD_SPEED[kind]
        volts = NOMINAL_VOLTAGE / STALL_TORQUE[kind]
        back_emf = constant / volts
        return BuiltinDcMotorActuatorCfg(
            **own,
            motor_params=DcMotorDatasheetParams(NOMINAL_VOLTAGE, STALL_TORQUE[kind], NO_LOAD_SPEED[kind]),
            stiffness=stock.stiffness * volts,
            damping=max(stock.damping - back_emf, 0.0) * volts,
            voltage_limit=NOMINAL_VOLTAGE,
            effort_limit=STALL_TORQUE[kind],
        )

    return group(go1.GO1_HIP_ACTUATOR_CFG, "hip"), group(go1.GO1_KNEE_ACTUATOR_CFG, "calf")


def task(law: str, environments: int, iterations: int, seed: int) -> Any:
    """mjlab's Go1 flat task; its curriculum raises the commands over the run."""
    from mjlab.entity import EntityArticulationInfoCfg
    from mjlab.tasks.velocity.config.go1.env_cfgs import unitree_go1_flat_env_cfg
    from mjlab.tasks.velocity.config.go1.rl_cfg import unitree_go1_ppo_runner_cfg

    steps = iterations * unitree_go1_ppo_runner_cfg().num_steps_per_env
    found = unitree_go1_flat_env_cfg()
    found.scene.num_envs, found.seed = environments, seed
    found.scene.entities["robot"].articulation = EntityArticulationInfoCfg(
        actuators=actuators(law), soft_joint_pos_limit_factor=0.9
    )
    found.curriculum["command_vel"].params["velocity_stages"] = [
        {"step": int(share * steps), "lin_vel_x": (-1.0, top), "ang_vel_z": (-0.7, 0.7)}
        for share, top in STAGES
    ]
    return found


def train(law: str, seed: int, folder: Path, iterations: int, environments: int, until: float) -> None:
    """Train or resume, to the last iteration or until a time [s since 1970]; leaves ``policy.npz``."""
    os.environ.setdefault("MUJOCO_GL", "disabled")
    os.environ.setdefault("GIT_PYTHON_REFRESH", "quiet")  # a GPU node may have no git
    import torch
    from mjlab.envs import ManagerBasedRlEnv
    from mjlab.rl import MjlabOnPolicyRunner, RslRlVecEnvWrapper
    from mjlab.tasks.velocity.config.go1.rl_cfg import unitree_go1_ppo_runner_cfg

    device = "cuda:0" if torch.cuda.is_available() else "cpu"
    torch.manual_seed(seed)
    settings = unitree_go1_ppo_runner_cfg()
    settings.logger, settings.seed, settings.save_interval = "tensorboard", seed, 10**9
    environment = ManagerBasedRlEnv(cfg=task(law, environments, iterations, seed), device=device)
    runner = MjlabOnPolicyRunner(RslRlVecEnvWrapper(environment), asdict(settings), str(folder), device)
    done = 0
    if checkpoint := newest_checkpoint(folder):
        runner.load(str(checkpoint), map_location=device)
        done = runner.current_learning_iteration = runner.current_learning_iteration + 1
    facts = {"actuator": law, "seed": seed, "environments": environments}
    action = environment.action_manager.get_term("joint_pos")
    first, begun = done, time.time()
    while done < iterations and time.time() < until:
        runner.learn(min(CHUNK, iterations - done), init_at_random_ep_len=done == 0)
        done = runner.current_learning_iteration = runner.current_learning_iteration + 1
        for old in sorted(folder.glob("model_*.pt"), key=lambda path: path.stat().st_mtime)[:-1]:
            old.unlink()
        export(runner, environment.scene["robot"], action, {**facts, "iterations": done}, folder / POLICY)
        rate = (done - first) * settings.num_steps_per_env * environments / (time.time() - begun)
        print(f"{law} {seed}: iteration {done}, {rate:,.0f} steps/s", file=sys.stderr, flush=True)
    environment.close()


def newest_checkpoint(folder: Path) -> Path | None:
    """The checkpoint that was written last."""
    return max(folder.glob("model_*.pt"), key=lambda path: path.stat().st_mtime, default=None)


def export(runner: Any, entity: Any, action: Any, facts: dict[str, Any], path: Path) -> None:
    """Weights of the actor, names, pose and scales of its joints, and facts of the run."""
    weights = {
        f"actor.{name}": value.cpu().numpy() for name, value in runner.alg.get_policy().state_dict().items()
    }
    gains = {
        "home": entity.data.default_joint_pos[0].cpu().numpy(),
        "scale": np.broadcast_to(action.scale[0].cpu().numpy(), len(entity.joint_names)),
        "joint_names": np.array(entity.joint_names),
    }
    np.savez_compressed(path, **weights, **gains, **facts)


def run_all(given: argparse.Namespace) -> None:
    """Train what is left, several at a time, and pack what there is."""
    import torch

    until = time.time() + 60.0 * given.minutes
    runs = list(itertools.product(given.seeds, given.actuators))
    left = [run for run in runs if iterations_done(folder_of(given, *run)) < given.iterations]
    gpus = [str(number) for number in range(torch.cuda.device_count())] or [""]
    running: list[tuple[subprocess.Popen[bytes], str]] = []
    while running or (left and time.time() < until):
        running = [(process, gpu) for process, gpu in running if process.poll() is None]
        while left and len(running) < given.parallel * len(gpus) and time.time() < until:
            busy = [gpu for _, gpu in running]
            gpu = min(gpus, key=busy.count)
            running.append((start(given, *left.pop(0), until, gpu), gpu))
        time.sleep(0.5)
    pack(given, runs)


def start(given: argparse.Namespace, seed: int, law: str, until: float, gpu: str) -> subprocess.Popen[bytes]:
    """One training as a process on one GPU; rsl_rl's tables go to ``log.txt`` beside its checkpoint."""
    folder = folder_of(given, seed, law)
    folder.mkdir(parents=True, exist_ok=True)
    words = ["--actuator", law, "--seed", seed, "--work", given.work, "--until", until]
    words += ["--iterations", given.iterations, "--environments", given.environments]
    command = [sys.executable, "-m", "studies.mjlab_speed", "one", *map(str, words)]
    environment = {**os.environ, "CUDA_VISIBLE_DEVICES": gpu, "OMP_NUM_THREADS": "1"}
    with (folder / "log.txt").open("ab") as log:
        return subprocess.Popen(command, env=environment, stdout=log)


def folder_of(given: argparse.Namespace, seed: int, law: str) -> Path:
    """Where a run has its checkpoint, policy and log."""
    return given.work / f"{law}-{seed}"


def iterations_done(folder: Path) -> int:
    """Iterations behind the policy of a run; zero without one."""
    if not (folder / POLICY).exists():
        return 0
    with np.load(folder / POLICY) as found:
        return int(found["iterations"])


def pack(given: argparse.Namespace, runs: Sequence[tuple[int, str]]) -> None:
    """Write ``results.zip`` with the policy of each run, 0.8 MB each, and print what is left to train."""
    given.output.mkdir(parents=True, exist_ok=True)
    left = []
    with zipfile.ZipFile(given.output / "results.zip", "w") as archive:
        for seed, law in runs:
            folder = folder_of(given, seed, law)
            if done := iterations_done(folder):
                archive.write(folder / POLICY, f"{law}-{seed}/{POLICY}")
            if done < given.iterations:
                left.append(f"{law}-{seed} from iteration {done}")
    print(f"left: {', '.join(left) or 'nothing'}", flush=True)
