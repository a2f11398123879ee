"""What a motor law is worth in mjlab: its own Go1 task, with faster commands, on three actuators.

Each run trains mjlab's flat velocity task with mjlab's and rsl_rl's own code; only the actuator differs and
the range of commanded speeds, which mjlab's own curriculum raises until the motors are the limit:

- ``stock``: mjlab's position actuators with a torque limit (``BuiltinPositionActuatorCfg``);
- ``data-sheet``: mjlab's brushed DC motor from stall torque and no-load speed (``DcMotorDatasheetParams``);
- ``refined``: the motor law of this package (``PmsmActuatorCfg``).

Every policy is then judged on one plant, MuJoCo C with the motors of our Go1: under the law that it was
trained with (what was promised) and under the refined law (what its motors give).

    python -m studies.mjlab_speed train --out OUT --iterations 600 --minutes 9   # again until nothing is left
    python -m studies.mjlab_speed page results/mjlab-speed docs                  # figure and table
"""

from __future__ import annotations

import argparse
import itertools
import json
import multiprocessing
import os
import subprocess
import sys
import time
import zipfile
from collections.abc import Callable, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from sprintlab.core.array_types import FloatArray
from sprintlab.evaluation.rollout_audit import audit_rollout
from sprintlab.evaluation.rollouts import Rollout
from sprintlab.motors import DriveOutput
from sprintlab.plant import BlindRecorder, Plant, PlantOptions, TrialSettings
from sprintlab.robots import RobotDescription, load_robot, match_joints, robot_motors

ACTUATORS = ("stock", "data-sheet", "refined")
STAGES = ((0.0, 1.5), (0.1, 2.0), (0.2, 3.0), (0.35, 4.0), (0.5, 5.0), (0.65, 6.0))
"""Share of the training from which commands go up to a speed [m/s]."""
STALL_TORQUE = {"hip": 23.7, "thigh": 23.7, "calf": 35.55}
"""Published for the Go1's joints [N m]."""
NO_LOAD_SPEED = {"hip": 30.1, "thigh": 30.1, "calf": 20.06}
"""Published [rad/s]."""
NOMINAL_VOLTAGE = 24.0
CHUNK = 50  # iterations between two looks at the clock
COMMANDS = tuple(np.arange(1.0, 6.01, 0.5))
SEEDS_OF_A_TRIAL = (1, 2, 3)
RISE, HOLD, JUDGED = 2.0, 5.0, 2.0  # [m/s^2], [s], the hold's last [s]
POLICY_STEPS = 20  # motor steps of 1 ms in one decision
HEADING_GAIN, LARGEST_YAW_RATE = 0.5, 0.7  # as in mjlab's heading commands [1/s], [rad/s]
IMU = np.array([-0.01592, -0.06659, -0.00617])  # of mjlab's Go1 in its trunk [m]


# --- training -----------------------------------------------------------------------------------------------


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
    """Train, or go on, to the last iteration or until a time [s since 1970]; then leave ``policy.npz``."""
    os.environ.setdefault("MUJOCO_GL", "disabled")
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
    if checkpoint := newest_checkpoint(folder):
        runner.load(str(checkpoint), map_location=device)
    begun, first = time.time(), runner.current_learning_iteration
    while (left := iterations - 1 - runner.current_learning_iteration) > 0 and time.time() < until:
        fresh = runner.current_learning_iteration == 0
        runner.learn(min(CHUNK, left + 1), init_at_random_ep_len=fresh)
        for old in sorted(folder.glob("model_*.pt"), key=lambda path: path.stat().st_mtime)[:-1]:
            old.unlink()
    done = runner.current_learning_iteration - first + 1
    steps = done * settings.num_steps_per_env * environments
    print(f"{law} {seed}: {steps / (time.time() - begun):,.0f} steps/s, iteration {first + done}", flush=True)
    if runner.current_learning_iteration >= iterations - 1:
        entity = environment.scene["robot"]
        export(runner, entity, environment.action_manager.get_term("joint_pos"), folder / "policy.npz")
    environment.close()


def newest_checkpoint(folder: Path) -> Path | None:
    """The one last written."""
    return max(folder.glob("model_*.pt"), key=lambda path: path.stat().st_mtime, default=None)


def export(runner: Any, entity: Any, action: Any, path: Path) -> None:
    """Weights of the actor, and what its joints are called, stand like and are scaled by."""
    weights = {
        f"actor.{name}": value.cpu().numpy() for name, value in runner.alg.get_policy().state_dict().items()
    }
    gains = {
        "home": entity.data.default_joint_pos[0].cpu().numpy(),
        "scale": np.broadcast_to(action.scale[0].cpu().numpy(), len(entity.joint_names)),
        "joint_names": np.array(entity.joint_names),
    }
    np.savez_compressed(path, **weights, **gains)


# --- judgement ----------------------------------------------------------------------------------------------


class Policy(NamedTuple):
    """An actor of rsl_rl: normalization, then layers with ELUs between them."""

    mean: FloatArray
    deviation: FloatArray
    layers: tuple[tuple[FloatArray, FloatArray], ...]
    home: FloatArray
    scale: FloatArray
    joint_names: tuple[str, ...]

    def action(self, observation: FloatArray) -> FloatArray:
        """Joint offsets before scaling ``(12,)``, in the order of ``joint_names``."""
        value = (observation - self.mean) / self.deviation
        for index, (weight, bias) in enumerate(self.layers):
            value = weight @ value + bias
            if index < len(self.layers) - 1:
                value = np.where(value > 0.0, value, np.expm1(np.minimum(value, 0.0)))
        return value


def load(path: Path) -> Policy:
    """Read what ``export`` wrote."""
    with np.load(path) as found:
        weights = sorted(
            (name for name in found if name.startswith("actor.mlp.") and name.endswith("weight")),
            key=lambda name: int(name.split(".")[2]),
        )
        layers = tuple((found[name], found[name.replace("weight", "bias")]) for name in weights)
        return Policy(
            mean=found["actor.obs_normalizer._mean"].ravel(),
            deviation=found["actor.obs_normalizer._std"].ravel() + 1e-2,  # rsl_rl's own epsilon
            layers=layers,
            home=found["home"],
            scale=found["scale"],
            joint_names=tuple(map(str, found["joint_names"])),
        )


def mjlabs_go1(policy: Policy) -> RobotDescription:
    """Our Go1 with the gains and the pose of mjlab's."""
    robot, inertia = load_robot("go1"), 0.000111842 * np.tile([36.0, 36.0, 81.0], 4)
    places = match_joints(policy.joint_names, robot.joint_names)
    home = np.empty(12)
    home[places] = policy.home
    frequency = 20.0 * 3.1415926535
    return replace(
        robot, default_pose=home, stiffness=inertia * frequency**2, damping=4.0 * inertia * frequency
    )


def promised_law(law: str) -> Callable[[FloatArray, FloatArray], DriveOutput] | None:
    """The law that a policy was trained with, for the plant's joints; ``None`` where the plant has it."""
    if law == "refined":
        return None
    kinds = ("hip", "thigh", "calf") * 4
    stall = np.array([STALL_TORQUE[kind] for kind in kinds])
    top = np.array([NO_LOAD_SPEED[kind] for kind in kinds])

    def given(wanted: FloatArray, speed: FloatArray) -> DriveOutput:
        line = speed / top if law == "data-sheet" else 0.0 * speed
        lower, upper = np.maximum(stall * (-1.0 - line), -stall), np.minimum(stall * (1.0 - line), stall)
        torque = np.clip(wanted, lower, upper)
        return DriveOutput(torque, torque, lower, upper, 0.0 * torque)

    return given


class Trial(NamedTuple):
    """One command held."""

    command: float
    """[m/s]"""
    speed: float
    """Mean forward speed over the last two seconds of the hold [m/s]; up to the fall where the robot fell."""
    fell: bool
    rollout: Rollout
    """Joint speeds and delivered torques of the hold."""
    unmet: float
    """Share of the wanted torque, over time and joints, that the drive does not give [-]."""


def hold(policy: Policy, law: str, command: float, seed: int, hold_time: float = HOLD) -> Trial:
    """Rise to a commanded speed and hold it, on our plant, under the law of a training or ``refined``."""
    robot = mjlabs_go1(policy)
    plant = Plant(robot, PlantOptions(), TrialSettings(seed=seed, joint_noise=0.05))
    if (drive := promised_law(law)) is not None:
        plant.use_drive(drive)
    places = match_joints(policy.joint_names, robot.joint_names)
    action, samples, speeds = np.zeros(12), [], []
    begin = 1.0 + command / RISE
    while plant.time < begin + hold_time and not plant.fall_reason:
        asked = min(command, max(0.0, plant.time - 1.0) * RISE)
        action = policy.action(observation(plant, policy, places, action, asked))
        targets = np.empty(12)
        targets[places] = policy.home + policy.scale * action
        for _ in range(POLICY_STEPS):
            position, velocity = plant.joint_state()
            position, velocity = position.copy(), velocity.copy()
            wanted = robot.stiffness * (targets - position) - robot.damping * velocity
            output = plant.drive_joints(wanted, targets, BlindRecorder())
            if plant.time >= begin:
                samples.append((velocity, wanted, output.torque.copy()))
        speeds.append((plant.time, plant.base_state().forward_speed))
    samples = samples or [(np.zeros(12),) * 3] * 2  # fell before the hold began
    velocity, wanted, torque = np.swapaxes(np.array(samples), 0, 1)
    late = [speed for moment, speed in speeds if moment > begin + hold_time - JUDGED]
    return Trial(
        command=command,
        speed=float(np.mean(late or [speeds[-1][1]])),
        fell=bool(plant.fall_reason),
        rollout=Rollout(
            time=0.001 * np.arange(len(velocity)),
            joint_velocity=velocity,
            joint_torque=torque,
            joint_names=robot.joint_names,
        ),
        unmet=float(np.abs(wanted - torque).sum() / max(np.abs(wanted).sum(), 1e-9)),
    )


def observation(
    plant: Plant, policy: Policy, places: Sequence[int], action: FloatArray, command: float
) -> FloatArray:
    """mjlab's 48 numbers: velocity of the IMU, rates, gravity, joints, last action, command."""
    seen = plant.measurement()
    turned = np.empty(9)
    import mujoco

    mujoco.mju_quat2Mat(turned, plant.data.qpos[3:7])
    velocity = turned.reshape(3, 3).T @ plant.data.qvel[:3] + np.cross(seen.angular_velocity, IMU)
    yaw = np.clip(-HEADING_GAIN * plant.base_state().heading, -LARGEST_YAW_RATE, LARGEST_YAW_RATE)
    return np.concatenate(
        [
            velocity,
            seen.angular_velocity,
            seen.projected_gravity,
            seen.joint_position[places] - policy.home,
            seen.joint_velocity[places],
            action,
            [command, 0.0, yaw],
        ]
    )


def judge(path: Path, law: str, seed: int, commands: Sequence[float], seeds: Sequence[int]) -> dict[str, Any]:
    """All trials of one policy under its own law and under the refined one."""
    policy, motors = load(path), robot_motors("go1")
    found: dict[str, Any] = {"actuator": law, "seed": seed, "trials": []}
    for under in dict.fromkeys((law, "refined")):
        for command, trial_seed in itertools.product(commands, seeds):
            one = hold(policy, under, float(command), trial_seed)
            verdict = audit_rollout(one.rollout, motors)
            found["trials"].append(
                {
                    "law": under,
                    "command": float(command),
                    "speed": round(one.speed, 3),
                    "fell": one.fell,
                    "unmet": round(one.unmet, 4),
                    "impossible": round(verdict.impossible, 4),
                }
            )
    found["promised"], found["delivered"] = reached(found["trials"], law), reached(found["trials"], "refined")
    return found


def reached(trials: Sequence[dict[str, Any]], law: str) -> dict[str, float]:
    """Fastest mean speed at a command that at most a third of the trials fall at, and what it took."""
    own = [trial for trial in trials if trial["law"] == law]
    groups = [[one for one in own if one["command"] == at] for at in sorted({one["command"] for one in own})]
    held = [group for group in groups if 3 * sum(one["fell"] for one in group) <= len(group)]
    best = max(held, key=lambda group: np.mean([one["speed"] for one in group]), default=groups[0])
    return {
        "speed": round(float(np.mean([one["speed"] for one in best])), 3) if held else 0.0,
        "command": best[0]["command"],
        "impossible": round(float(np.mean([one["impossible"] for one in best])), 4),
        "unmet": round(float(np.mean([one["unmet"] for one in best])), 4),
        "falls": round(float(np.mean([one["fell"] for one in own])), 4),
    }


# --- many runs ----------------------------------------------------------------------------------------------


def run_all(given: argparse.Namespace) -> None:
    """Train what is left, several at a time, judge what is done, and pack it."""
    until = time.time() + 60.0 * given.minutes
    runs = list(itertools.product(given.seeds, given.actuators))
    left = [run for run in runs if not (folder_of(given, *run) / "policy.npz").exists()]
    going: list[subprocess.Popen[bytes]] = []
    while left or going:
        going = [process for process in going if process.poll() is None]
        while left and len(going) < given.parallel and time.time() < until:
            seed, law = left.pop(0)
            folder_of(given, seed, law).mkdir(parents=True, exist_ok=True)
            words = ["--actuator", law, "--seed", seed, "--work", given.work, "--until", until]
            words += ["--iterations", given.iterations, "--environments", given.environments]
            going.append(
                subprocess.Popen([sys.executable, "-m", "studies.mjlab_speed", "one", *map(str, words)])
            )
        if time.time() > until and not going:
            break
        time.sleep(0.5)
    done = [(folder_of(given, *run) / "policy.npz", run[1], run[0]) for run in runs]
    done = [one for one in done if one[0].exists() and not one[0].with_name("result.json").exists()]
    jobs = [(*one, given.commands, given.trials, given.iterations, given.environments) for one in done]
    with multiprocessing.get_context("spawn").Pool(min(given.jobs, len(jobs) or 1)) as pool:
        pool.starmap(judge_into, jobs)
    pack(given, runs)


def judge_into(
    path: Path,
    law: str,
    seed: int,
    commands: Sequence[float],
    trials: int,
    iterations: int,
    environments: int,
) -> None:
    """Write ``result.json`` beside a policy."""
    found = judge(path, law, seed, commands, SEEDS_OF_A_TRIAL[:trials])
    found |= {"iterations": iterations, "environments": environments}
    path.with_name("result.json").write_text(json.dumps(found, indent=1) + "\n")
    print(f"{law} {seed}: promised {found['promised']}, delivered {found['delivered']}", flush=True)


def folder_of(given: argparse.Namespace, seed: int, law: str) -> Path:
    """Of one run."""
    return given.work / f"{law}-{seed}"


def pack(given: argparse.Namespace, runs: Sequence[tuple[int, str]]) -> None:
    """``results.zip`` of policies and results (0.8 MB a run), and what is left to do."""
    given.out.mkdir(parents=True, exist_ok=True)
    left = []
    with zipfile.ZipFile(given.out / "results.zip", "w") as archive:
        for seed, law in runs:
            folder = folder_of(given, seed, law)
            for name in ("policy.npz", "result.json"):
                if (folder / name).exists():
                    archive.write(folder / name, f"{law}-{seed}/{name}")
            if not (folder / "result.json").exists():
                left.append(f"{law}-{seed}")
    print(f"left: {', '.join(left) or 'nothing'}", flush=True)


# --- page ---------------------------------------------------------------------------------------------------


def page(results: Path, docs: Path) -> None:
    """Figure and page of all results in a folder."""
    from sprintlab.core.theme import LIGHT, axis_legend, save_figure, set_title, themed_figure

    found = [json.loads(path.read_text()) for path in sorted(results.glob("*/result.json"))]
    figure, axes = themed_figure(LIGHT, (9.0, 3.4), 1, 3, sharey=True)
    for axis, law in zip(axes, ACTUATORS, strict=True):
        for under, color, label in (
            ("refined", LIGHT.on_limit, "delivered: refined law"),
            (law, LIGHT.inside, "promised: its own law"),
        ):
            points = [one for run in found if run["actuator"] == law for one in run["trials"]]
            points = [one for one in points if one["law"] == under and not one["fell"]]
            axis.plot(
                [one["command"] for one in points],
                [one["speed"] for one in points],
                ".", ms=4, color=color, label=label,
            )  # fmt: skip
        axis.plot([0, COMMANDS[-1]], [0, COMMANDS[-1]], color=LIGHT.muted, lw=0.7)
        set_title(axis, law, LIGHT)
        axis.set_xlabel("commanded [m/s]")
    axes[0].set_ylabel("held [m/s]")
    axis_legend(axes[0], LIGHT, loc="upper left")
    save_figure(docs / "figures" / "mjlab-speed.png", figure, dpi=110)
    (docs / "mjlab-speed.md").write_text(text(found), encoding="utf-8")


def text(found: Sequence[dict[str, Any]]) -> str:
    """The page: the table first."""
    rows = []
    for law in ACTUATORS:
        own = [run for run in found if run["actuator"] == law]
        if not own:
            continue

        def middle(part: str, key: str, runs: Sequence[dict[str, Any]] = own) -> str:
            values = sorted(run[part][key] for run in runs)
            shown = [f"{100 * v:.0f} %" if key != "speed" else f"{v:.2f}" for v in values]
            return f"{shown[len(shown) // 2]} ({shown[0]} to {shown[-1]})"

        cells = (
            middle("promised", "speed"),
            middle("delivered", "speed"),
            middle("promised", "impossible"),
            middle("delivered", "falls"),
        )
        rows.append(f"| `{law}` | " + " | ".join(cells) + " |")
    one = found[0]
    steps = one["iterations"] * one["environments"] * 24 / 1e6
    return PAGE.format(runs=len(found), steps=steps, rows="\n".join(rows), iterations=one["iterations"])


PAGE = """# What the motor law is worth in mjlab

mjlab's own Go1 on flat ground, trained by mjlab's and rsl_rl's code with commands up to 6 m/s on three
actuators: {runs} trainings of {steps:.0f} million steps. Each is judged on our plant, under the law that it
was trained with and under the refined law of its motors. Median of the seeds (least to most).

| actuator in training | promised [m/s] | delivered [m/s] | torque that no motor gives | falls |
|---|---|---|---|---|
{rows}

![Held over commanded speed under the law of the training and under the refined law](figures/mjlab-speed.png)

*Promised*: fastest speed held on the plant when the drives obey the law of the training. *Delivered*: the
same policy when they obey the refined law. *Torque that no motor gives*: share of the samples of the promised
run beyond the refined envelope, as `sprintlab audit` counts it. *Falls*: of all trials under the refined law,
commands 1 to 6 m/s.

```sh
python -m studies.mjlab_speed train --out OUT --iterations {iterations} --minutes 9
```
"""


def main(words: Sequence[str] | None = None) -> None:
    """Read the command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    commands = parser.add_subparsers(dest="command", required=True)
    for name in ("train", "one"):
        part = commands.add_parser(name)
        part.add_argument("--work", type=Path, default=Path("/tmp/mjlab-speed"), help="checkpoints are here")
        part.add_argument("--iterations", type=int, default=600)
        part.add_argument("--environments", type=int, default=4096)
        if name == "one":
            part.add_argument("--actuator", choices=ACTUATORS)
            part.add_argument("--seed", type=int)
            part.add_argument("--until", type=float)
            continue
        part.add_argument("--out", type=Path, required=True)
        part.add_argument("--actuators", nargs="+", choices=ACTUATORS, default=ACTUATORS)
        part.add_argument("--seeds", type=int, nargs="+", default=(1, 2, 3))
        part.add_argument("--minutes", type=float, default=9.0, help="no training goes on for longer")
        part.add_argument("--parallel", type=int, default=3, help="trainings at a time")
        part.add_argument("--jobs", type=int, default=9, help="judgements at a time")
        part.add_argument("--commands", type=float, nargs="+", default=COMMANDS)
        part.add_argument("--trials", type=int, default=len(SEEDS_OF_A_TRIAL))
    part = commands.add_parser("page")
    part.add_argument("results", type=Path)
    part.add_argument("docs", type=Path)
    given = parser.parse_args(words)
    if given.command == "train":
        run_all(given)
    elif given.command == "one":
        folder = folder_of(given, given.seed, given.actuator)
        train(given.actuator, given.seed, folder, given.iterations, given.environments, given.until)
    else:
        page(given.results, given.docs)


if __name__ == "__main__":
    main()
