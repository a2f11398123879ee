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
SLOWEST_TOP, HIGHEST_TOP, RAISE = 1.0, 6.5, 0.1
"""Commands go up to the first at the beginning, at most up to the second, and rise by the third [m/s]."""
FAST, TRACKED = 0.75, 0.5
"""Commands rise while robots whose command is above this share of the fastest earn this share of mjlab's
tracking reward. Averaged over all robots, slow commands hide that those with fast ones stand still."""
PATIENCE = 4  # iterations between two raises, at least
WALKING = "walking"
"""Name of the training from whose last checkpoint every other one begins: mjlab's own actuator."""
WALKING_ITERATIONS = 320
"""Its length; it then walks at 1 m/s."""
STALL_TORQUE = {"hip": 23.7, "thigh": 23.7, "calf": 35.55}
"""Published for the Go1's joints [N m]."""
NO_LOAD_SPEED = {"hip": 30.1, "thigh": 30.1, "calf": 20.06}
"""Published [rad/s]."""
NOMINAL_VOLTAGE = 24.0
STEPS_PER_ITERATION = 24
"""Policy steps per robot between two updates in mjlab's task."""
ITERATIONS, CHUNK = 400, 10  # of each training; between two checkpoints
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


class CommandRange:
    """mjlab's curriculum term: commands rise while the robots follow the fastest that there are."""

    def __init__(self, top: float) -> None:
        self.top, self.tracked = top, 0.0  # of the forward speeds commanded [m/s]; what was tracked lately
        self._earned, self._counted, self._steps = 0.0, 0.0, 0

    def __deepcopy__(self, memo: dict[int, Any]) -> CommandRange:
        """mjlab copies its settings; the range stays one."""
        return self

    def __call__(self, env: Any, env_ids: Any, command_name: str) -> dict[str, float]:
        """mjlab calls this whenever robots restart: in nearly every step."""
        rewards, name = env.reward_manager, "track_linear_velocity"
        commands = env.command_manager.get_term(command_name)
        earned = rewards._step_reward[:, rewards.active_terms.index(name)]
        fast = (commands.command[:, 0] > FAST * self.top).float()
        self._earned, self._counted = self._earned + (fast * earned).sum(), self._counted + fast.sum()
        self._steps += 1
        if self._steps >= PATIENCE * STEPS_PER_ITERATION:
            weight = rewards.get_term_cfg(name).weight
            self.tracked = float(self._earned) / max(float(self._counted), 1.0) / weight
            self.top = min(self.top + RAISE * (self.tracked > TRACKED), HIGHEST_TOP)
            self._earned, self._counted, self._steps = 0.0, 0.0, 0
        commands.cfg.ranges.lin_vel_x = (-1.0, self.top)
        return {"top": self.top, "tracked": self.tracked}


def task(law: str, environments: int, seed: int, commands: CommandRange) -> Any:
    """mjlab's Go1 flat task; its curriculum raises the commands."""
    from mjlab.entity import EntityArticulationInfoCfg
    from mjlab.managers.curriculum_manager import CurriculumTermCfg
    from mjlab.tasks.velocity.config.go1.env_cfgs import unitree_go1_flat_env_cfg

    found = unitree_go1_flat_env_cfg()
    found.scene.num_envs, found.seed = environments, seed
    found.scene.entities["robot"].articulation = EntityArticulationInfoCfg(
        actuators=actuators(law), soft_joint_pos_limit_factor=0.9
    )
    found.curriculum["command_vel"] = CurriculumTermCfg(func=commands, params={"command_name": "twist"})
    return found


def train(law: str, seed: int, folder: Path, iterations: int, environments: int, until: float) -> None:
    """Train or resume, to the last iteration or until a time [s since 1970]; leaves ``policy.npz``.

    A new run begins with the networks of the run ``walking`` beside it, if there is one.
    """
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
    before = folder if newest_checkpoint(folder) else folder.with_name(WALKING)
    commands = CommandRange(fact(before, "top", SLOWEST_TOP))
    environment = ManagerBasedRlEnv(cfg=task(law, environments, seed, commands), device=device)
    runner = MjlabOnPolicyRunner(RslRlVecEnvWrapper(environment), asdict(settings), str(folder), device)
    if checkpoint := newest_checkpoint(before):
        runner.load(str(checkpoint), map_location=device)
    done = runner.current_learning_iteration = fact(folder, "iterations", 0)
    facts = {"actuator": law, "seed": seed, "environments": environments}
    action = environment.action_manager.get_term("joint_pos")
    first, begun = done, time.time()
    while done < iterations and time.time() < until:
        runner.learn(min(CHUNK, iterations - done), init_at_random_ep_len=done == 0)
        done = runner.current_learning_iteration = runner.current_learning_iteration + 1
        for old in sorted(folder.glob("model_*.pt"), key=lambda path: path.stat().st_mtime)[:-1]:
            old.unlink()
        now = {**facts, "iterations": done, "top": commands.top}
        export(runner, environment.scene["robot"], action, now, folder / POLICY)
        rate = (done - first) * settings.num_steps_per_env * environments / (time.time() - begun)
        said = f"iteration {done}, {rate:,.0f} steps/s, commands up to {commands.top:.1f} m/s"
        print(f"{folder.name}: {said}, {commands.tracked:.2f} tracked", file=sys.stderr, flush=True)
    environment.close()


def fact(folder: Path, name: str, otherwise: Any) -> Any:
    """A fact of the run in a folder, as its policy has it; else the third."""
    if not (folder / POLICY).exists():
        return otherwise
    with np.load(folder / POLICY) as found:
        return found[name].item()


def newest_checkpoint(folder: Path) -> Path | None:
    """The checkpoint that was written last."""
    return max(folder.glob("model_*.pt"), key=lambda path: path.stat().st_mtime, default=None)


def export(runner: Any, entity: Any, action: Any, facts: dict[str, Any], path: Path) -> None:
    """Weights of the actor, names, pose and scales of its joints, and facts of the run."""
    weights = {
        f"actor.{name}": value.cpu().numpy() for name, value in runner.alg.get_policy().state_dict().items()
    }
    joints = {
        "home": entity.data.default_joint_pos[0].cpu().numpy(),
        "scale": np.broadcast_to(action.scale[0].cpu().numpy(), len(entity.joint_names)),
        "joint_names": np.array(entity.joint_names),
    }
    np.savez_compressed(path, **weights, **joints, **facts)


def run_all(given: argparse.Namespace) -> None:
    """Learn to walk, train what is left, several at a time, and pack what there is."""
    until = time.time() + 60.0 * given.minutes
    runs = list(itertools.product(given.seeds, given.actuators))
    walking, gpus = given.work / WALKING, visible_gpus()
    if fact(walking, "iterations", 0) < WALKING_ITERATIONS:
        start(given, walking, 0, "stock", WALKING_ITERATIONS, until, gpus[0]).wait()
    left = [run for run in runs if fact(folder_of(given, *run), "iterations", 0) < given.iterations]
    running: list[tuple[subprocess.Popen[bytes], str]] = []
    while running or (left and time.time() < until):
        running = [(process, gpu) for process, gpu in running if process.poll() is None]
        while left and len(running) < given.parallel * len(gpus) and time.time() < until:
            busy = [gpu for _, gpu in running]
            gpu, run = min(gpus, key=busy.count), left.pop(0)
            process = start(given, folder_of(given, *run), *run, given.iterations, until, gpu)
            running.append((process, gpu))
        time.sleep(0.5)
    pack(given, runs)


def visible_gpus() -> list[str]:
    """GPUs that this process may use, as ``CUDA_VISIBLE_DEVICES`` names them; one without a name on a CPU."""
    import torch

    named = os.environ.get("CUDA_VISIBLE_DEVICES")
    return named.split(",") if named else list(map(str, range(torch.cuda.device_count()))) or [""]


def start(
    given: argparse.Namespace, folder: Path, seed: int, law: str, iterations: int, until: float, gpu: str
) -> subprocess.Popen[bytes]:
    """One training as a process on one GPU; rsl_rl's tables go to ``log.txt`` beside its checkpoint."""
    folder.mkdir(parents=True, exist_ok=True)
    words = ["--folder", folder, "--actuator", law, "--seed", seed, "--until", until]
    words += ["--iterations", iterations, "--environments", given.environments]
    command = [sys.executable, "-m", "studies.mjlab_speed", "one", *map(str, words)]
    environment = {**os.environ, "CUDA_VISIBLE_DEVICES": gpu, "OMP_NUM_THREADS": "1"}
    with (folder / "log.txt").open("ab") as log:
        return subprocess.Popen(command, env=environment, stdout=log)


def folder_of(given: argparse.Namespace, seed: int, law: str) -> Path:
    """Where a run has its checkpoint, policy and log."""
    return given.work / f"{law}-{seed}"


def pack(given: argparse.Namespace, runs: Sequence[tuple[int, str]]) -> None:
    """Write ``results.zip`` with the policy of each run, 0.8 MB each, and print what is left to train."""
    given.output.mkdir(parents=True, exist_ok=True)
    left = []
    with zipfile.ZipFile(given.output / "results.zip", "w") as archive:
        for seed, law in runs:
            folder = folder_of(given, seed, law)
            if done := fact(folder, "iterations", 0):
                archive.write(folder / POLICY, f"{law}-{seed}/{POLICY}")
            if done < given.iterations:
                left.append(f"{law}-{seed} from iteration {done}")
    print(f"left: {', '.join(left) or 'nothing'}", flush=True)
