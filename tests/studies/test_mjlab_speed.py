"""The comparison of actuators in mjlab: what carries a policy from mjlab to our plant loses nothing."""

import copy
import importlib.util
from types import SimpleNamespace

import mujoco
import numpy as np
import pytest

pytest.importorskip("torch", reason="needs PyTorch: pip install 'sprintlab[mjlab]'")
if importlib.util.find_spec("mjlab") is None:
    pytest.skip("needs mjlab: pip install 'sprintlab[mjlab]'", allow_module_level=True)

from studies.mjlab_speed import judge as study
from studies.mjlab_speed import train as training

from sprintlab.plant import Plant, PlantOptions, TrialSettings
from sprintlab.robots import match_joints


@pytest.fixture(scope="module")
def trained(tmp_path_factory):
    """One iteration of two robots: the runner, its environment and the file it leaves."""
    import torch

    torch.set_num_threads(1)
    folder, found, saved = tmp_path_factory.mktemp("run"), {}, training.export

    def export(runner, *others):
        found.update(runner=runner, env=runner.env.unwrapped)
        saved(runner, *others)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(training, "export", export)
        training.train("refined", 1, folder, 1, 2, until=float("inf"))
    return found["runner"], found["env"], folder / "policy.npz"


@pytest.mark.slow
def test_the_policy_in_numpy_is_that_of_rsl_rl(trained):
    import torch
    from tensordict import TensorDict

    runner, _, path = trained
    policy, seen = study.load(path), np.random.default_rng(0).normal(size=48)
    batch = TensorDict({"actor": torch.tensor(seen[None], dtype=torch.float32)}, batch_size=[1])
    with torch.no_grad():
        expected = runner.get_inference_policy("cpu")(batch)[0].numpy()
    assert policy.action(seen) == pytest.approx(expected, rel=1e-3, abs=1e-4)


@pytest.mark.slow
def test_the_plant_shows_a_policy_what_mjlab_shows(trained):
    """The same state in both simulators: position, attitude, velocities, joints in each one's order."""
    import torch

    _, env, path = trained
    policy, random = study.load(path), np.random.default_rng(1)
    robot = study.mjlabs_go1(policy)
    plant = Plant(robot, PlantOptions(), TrialSettings())
    places = match_joints(policy.joint_names, robot.joint_names)
    quaternion = random.normal(size=4) * 0.1 + [1.0, 0.0, 0.0, 0.0]
    quaternion /= np.linalg.norm(quaternion)
    velocity, speeds = random.normal(size=6), random.normal(size=12)
    joints = policy.home + 0.1 * random.normal(size=12)
    for place, position, speed in zip(places, joints, speeds, strict=True):
        joint = plant.data.joint(robot.joint_names[place])
        joint.qpos[0], joint.qvel[0] = position, speed
    plant.data.qpos[3:7], plant.data.qvel[:6] = quaternion, velocity
    entity = env.scene["robot"]
    free = torch.tensor([0.0, 0.0, 0.4, *quaternion], dtype=torch.float32).expand(2, 7)
    entity.write_root_link_pose_to_sim(free)
    turned = np.empty(9)
    mujoco.mju_quat2Mat(turned, quaternion)
    world = np.concatenate([velocity[:3], turned.reshape(3, 3) @ velocity[3:]])
    entity.write_root_link_velocity_to_sim(torch.tensor(world, dtype=torch.float32).expand(2, 6))
    state = (torch.tensor(value[None].repeat(2, 0), dtype=torch.float32) for value in (joints, speeds))
    entity.write_joint_state_to_sim(*state)
    env.sim.forward()
    env.scene.update(0.0)
    expected = {
        name: term.func(env, **term.params)[0].numpy()
        for name, term in env.cfg.observations["actor"].terms.items()
        if name not in ("actions", "command", "joint_pos")
    }
    seen = study.observation(plant, policy, places, np.zeros(12), np.zeros(3))
    motion = [expected[name] for name in ("base_lin_vel", "base_ang_vel", "projected_gravity")]
    wanted = np.concatenate([*motion, joints - policy.home, expected["joint_vel"]])
    assert seen[:33] == pytest.approx(wanted, abs=1e-4)


@pytest.mark.parametrize(("earned", "rises"), [(1.4, True), (0.6, False)])
def test_commands_rise_only_while_robots_follow(earned: float, rises: bool) -> None:
    """The weight is 2: robots with fast commands earn 0.7 of it, or 0.3; slow ones do not count."""
    import torch

    ranges = SimpleNamespace(lin_vel_x=None)
    given = torch.tensor([[1.9, 0.0, 0.0]] * 2 + [[0.5, 0.0, 0.0]] * 2)
    env = SimpleNamespace(
        reward_manager=SimpleNamespace(
            active_terms=["upright", "track_linear_velocity"],
            _step_reward=torch.tensor([[9.0, earned]] * 2 + [[9.0, 2.0 - earned]] * 2),
            get_term_cfg=lambda name: SimpleNamespace(weight=2.0),
        ),
        command_manager=SimpleNamespace(
            get_term=lambda name: SimpleNamespace(cfg=SimpleNamespace(ranges=ranges), command=given)
        ),
    )
    commands = copy.deepcopy(training.CommandRange(2.0))
    for _ in range(2 * training.PATIENCE * training.STEPS_PER_ITERATION):
        commands(env, None, "twist")
    assert ranges.lin_vel_x == pytest.approx((-1.0, 2.0 + 2 * training.RAISE * rises))
