"""What the motor law costs beside other simulators' own actuators: ``python benchmarks/integrations.py``.

Times one call of each framework's stock actuators and of ours on this machine's CPU with one thread; what is
not installed is left out, and keeps what an earlier call on this processor found. Writes
``results/integrations/cost.json``: microseconds per physics step.
"""

from __future__ import annotations

import argparse
import importlib.metadata
import json
import os
import platform
import time
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import mujoco
import numpy as np

from sprintlab.robots import ModelOptions, build_model, load_robot, robot_motors

NAMES = [f"{leg}_{kind}_joint" for leg in ("FL", "FR", "RL", "RR") for kind in ("hip", "thigh", "calf")]
MOTORS = robot_motors("go1")
PEAK, TOP, STIFFNESS, DAMPING = 23.7, 30.1, 20.0, 1.0
RANDOM = np.random.default_rng(0)


def microseconds(call: Callable[[], object], least: float = 0.4) -> float:
    """Median time of a call over at least nine, and ``least`` seconds."""
    call()
    times: list[float] = []
    while sum(times) < least or len(times) < 9:
        begun = time.perf_counter()
        call()
        times.append(time.perf_counter() - begun)
    return round(1e6 * float(np.median(times)), 1)


def isaac_lab(robots: int) -> dict[str, float]:
    import torch
    from isaaclab.actuators import DCMotorCfg, IdealPDActuatorCfg

    from sprintlab.integrations.isaaclab import pmsm_actuator

    gains = {"joint_names_expr": NAMES, "stiffness": STIFFNESS, "damping": DAMPING}
    limits = {"actuator_effort_limit": PEAK, "actuator_velocity_limit": TOP}
    configurations = {
        "IdealPDActuator": IdealPDActuatorCfg(**gains, **limits),
        "DCMotor": DCMotorCfg(**gains, **limits, saturation_effort=PEAK),
        "PmsmActuator": pmsm_actuator(NAMES, MOTORS, stiffness=STIFFNESS, damping=DAMPING),
    }
    target, position, speed = (
        torch.tensor(RANDOM.normal(size=(robots, 12)), dtype=torch.float32) for _ in range(3)
    )
    still = torch.zeros_like(target)
    found = {}
    for name, cfg in configurations.items():
        actuator = cfg.class_type(cfg, NAMES, slice(None), robots, "cpu")

        def call(actuator: object = actuator) -> None:
            action = SimpleNamespace(joint_positions=target, joint_velocities=still, joint_efforts=still)
            actuator.compute(action, position, 10.0 * speed)

        found[name] = microseconds(call)
    return found


def mjlab(robots: int) -> dict[str, float]:
    import torch
    from mjlab.actuator import ActuatorCmd, DcMotorActuatorCfg, IdealPdActuatorCfg

    from sprintlab.integrations.mjlab import PmsmActuatorCfg

    own = {"target_names_expr": (".*",), "stiffness": STIFFNESS, "damping": DAMPING}
    configurations = {
        "IdealPdActuator": IdealPdActuatorCfg(**own, effort_limit=PEAK),
        "DcMotorActuator": DcMotorActuatorCfg(
            **own, effort_limit=PEAK, saturation_effort=PEAK, velocity_limit=TOP
        ),
        "PmsmActuator": PmsmActuatorCfg(**own, motors=MOTORS),
    }
    entity = SimpleNamespace(indexing=SimpleNamespace(ctrl_ids=torch.arange(12)))
    command = ActuatorCmd(
        **{
            name: torch.tensor(RANDOM.normal(0.0, scale, (robots, 12)), dtype=torch.float32)
            for name, scale in (
                ("position_target", 1.0),
                ("velocity_target", 0.0),
                ("effort_target", 0.0),
                ("pos", 1.0),
                ("vel", 10.0),
            )
        }
    )
    found = {}
    for name, cfg in configurations.items():
        actuator = cfg.build(entity, list(range(12)), NAMES)
        actuator._mjs_actuators = [SimpleNamespace(id=at) for at in range(12)]
        timestep = SimpleNamespace(opt=SimpleNamespace(timestep=0.005))
        actuator.initialize(timestep, None, SimpleNamespace(nworld=robots), "cpu")
        found[name] = microseconds(lambda actuator=actuator: actuator.compute(command))
    return found


def newton(robots: int) -> dict[str, float]:
    import warp as wp
    from newton.actuators import ClampingDCMotor, ClampingMaxEffort

    from sprintlab.integrations.newton import pmsm_clampings

    count = 12 * robots
    indices = wp.array(np.arange(count, dtype=np.uint32), dtype=wp.uint32, device="cpu")
    wanted, speed = (
        wp.array(RANDOM.normal(0.0, scale, count).astype(np.float32), device="cpu") for scale in (30.0, 10.0)
    )
    given = wp.zeros(count, dtype=float, device="cpu")
    line = {"saturation_effort": PEAK, "velocity_limit": TOP, "max_motor_effort": PEAK}
    stages = {
        "ClampingMaxEffort": [(ClampingMaxEffort, {"max_effort": PEAK})] * 12,
        "ClampingDCMotor": [(ClampingDCMotor, line)] * 12,
        "PmsmClamping": list(pmsm_clampings(NAMES, MOTORS).values()),
    }
    found = {}
    for name, joints in stages.items():
        kind = joints[0][0]
        values = [kind.resolve_arguments(dict(arguments)) for _, arguments in joints] * robots
        arrays = {
            field: wp.array(np.array([each[field] for each in values], np.float32), device="cpu")
            for field in values[0]
        }
        stage = kind(**arrays)
        found[name] = microseconds(
            lambda stage=stage: stage.modify_forces(wanted, given, speed, speed, indices, indices, "cpu")
        )
    return found


def playground(robots: int) -> dict[str, float]:
    import jax
    import jax.numpy as jp

    from sprintlab.integrations.playground import MotorStep

    model = mujoco.MjModel.from_xml_string(
        "<mujoco><worldbody>"
        + "".join(f"<body><joint name='{name}'/><geom size='.1'/></body>" for name in NAMES)
        + "</worldbody><actuator>"
        + "".join(f"<position joint='{name}'/>" for name in NAMES)
        + "</actuator></mujoco>"
    )
    step = MotorStep(model, MOTORS, STIFFNESS, DAMPING)
    position, speed, target = (jp.array(RANDOM.normal(size=(robots, 12))) for _ in range(3))

    def stock(position: jax.Array, speed: jax.Array, target: jax.Array) -> jax.Array:
        return jp.clip(STIFFNESS * (target - position) - DAMPING * speed, -PEAK, PEAK)

    def ours(position: jax.Array, speed: jax.Array, target: jax.Array) -> jax.Array:
        return step.torque(SimpleNamespace(qpos=position, qvel=speed), target)

    found = {}
    for name, law in (("clipped PD", stock), ("MotorStep", ours)):
        compiled = jax.jit(jax.vmap(law))
        found[name] = microseconds(
            lambda compiled=compiled: compiled(position, 10.0 * speed, target).block_until_ready()
        )
    return found


def plain_mujoco(_: int) -> dict[str, float]:
    """One robot: a whole step of MuJoCo C, with a PD loop in Python on MuJoCo's motors or on ours."""
    from sprintlab.integrations.mjcf import motor_callback

    robot = load_robot("go1")
    model = build_model(robot, ModelOptions(timestep=0.002))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)

    def wanted(data: mujoco.MjData) -> np.ndarray:
        return robot.stiffness * (robot.default_pose - data.qpos[7:]) - robot.damping * data.qvel[6:]

    def clipped(_: mujoco.MjModel, data: mujoco.MjData) -> None:
        data.ctrl[:] = np.clip(wanted(data), -PEAK, PEAK)

    mujoco.set_mjcb_control(clipped)
    found = {"callback that clips": microseconds(lambda: mujoco.mj_step(model, data))}
    mujoco.set_mjcb_control(None)
    with motor_callback(model, wanted, MOTORS):
        found["motor_callback"] = microseconds(lambda: mujoco.mj_step(model, data))
    return found


GUESTS = {
    "isaaclab": isaac_lab,
    "mjlab": mjlab,
    "newton": newton,
    "playground": playground,
    "mujoco": plain_mujoco,
}
PACKAGES = {"playground": "jax"}


def main() -> None:
    """Time what is installed."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--robots", type=int, default=4096)
    parser.add_argument("--output", type=Path, default=Path("results/integrations/cost.json"))
    given = parser.parse_args()
    if hasattr(os, "sched_setaffinity"):  # on one core every framework's pool has one thread
        os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
    setting = {"robots": given.robots, "processor": processor(), "threads": 1}
    found: dict[str, object] = dict(setting)
    if given.output.exists():
        before = json.loads(given.output.read_text(encoding="utf-8"))
        if setting.items() <= before.items():
            found = before
    for name, guest in GUESTS.items():
        try:
            times = guest(given.robots)
        except ImportError as error:
            print(f"{name}: left out, {error}")
            continue
        package = PACKAGES.get(name, name)
        found[name] = {"version": importlib.metadata.version(package), "microseconds_per_step": times}
        print(name, found[name])
    given.output.write_text(json.dumps(found, indent=2) + "\n", encoding="utf-8")


def processor() -> str:
    """Its name, where the system tells."""
    path = Path("/proc/cpuinfo")
    lines = path.read_text().splitlines() if path.exists() else []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor()


if __name__ == "__main__":
    main()
