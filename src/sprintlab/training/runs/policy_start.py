"""A training that begins from a policy file, which has the policy and the estimator but nothing that judges.

The critic and the decoder begin from nothing. Advantages of a critic that knows nothing would ruin the
policy, so the policy rests until they have learned. Reading needs no PyTorch.
"""

from __future__ import annotations

import copy
import itertools
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import numpy.typing as npt

from sprintlab.control import ESTIMATE_SIZE, Policy, load_policy, read_again
from sprintlab.core.checks import check_range
from sprintlab.core.errors import InvalidValueError, PolicyFileError, SprintlabError
from sprintlab.robots import load_robot
from sprintlab.training.runs.checkpoint import LARGEST_COUNT, Progress
from sprintlab.training.settings import NORMALIZER_FLOOR, TrainingSettings

if TYPE_CHECKING:
    import torch

    from sprintlab.training.learner.algorithm import EstimatorPpo
    from sprintlab.training.learner.networks import Actor
    from sprintlab.training.runs.runner import Runner

_ACTOR_COUNT, _CRITIC_COUNT = 2e9, 2e7  # samples: the policy's inputs do not shift, the critic's hardly
_FIRST_RATE, _RATE_AFTER_REST = 5e-4, 2e-4
_DECODER = "estimator.decoder."


class PolicyStart(NamedTuple):
    """A policy file to begin from.

    Attributes:
        path: of the file.
        policy: as ONNX Runtime runs it, with its contract.
        weights: by their names in the actor's state dict, first layers without the columns of zeros.
    """

    path: Path
    policy: Policy
    weights: dict[str, npt.NDArray[np.float32]]


def is_policy_file(path: Path | None) -> bool:
    """Whether a run that begins from this begins from a policy file, not from a checkpoint."""
    return path is not None and path.suffix.lower() == ".onnx"


def read_policy_start(path: Path, settings: TrainingSettings, iterations: int) -> PolicyStart:
    """Read a policy file for a training with these settings that ends at ``iterations``.

    Raises:
        PolicyFileError: it is no policy file, or its network lacks something.
        ContractMismatchError: it is of another robot.
        SprintlabError: its observation or the sizes of its networks are not those of the settings.
        InvalidValueError: it has as many iterations already, or has counted what no run counts.
    """
    policy = load_policy(path, load_robot(settings.robot))
    done = policy.contract.training
    check_range(f"{path}: training.iterations", done.iterations, 0, 10**9)
    check_range(f"{path}: training.environment_steps", done.environment_steps, 0, LARGEST_COUNT)
    check_iterations_left(path, done.iterations, iterations)
    observation = settings.observation.for_joints(policy.layout.joints)
    if not policy.estimates or policy.layout != observation:
        raise SprintlabError(f"{path}: scales or history_length of its observation are not of these settings")
    shapes = _shapes(settings, policy.layout.joints)
    return PolicyStart(path, policy, _read_weights(path, read_again(path, policy), shapes))


def check_iterations_left(path: Path, reached: int, iterations: int) -> None:
    """Refuse a run that would end where it begins. Raises ``InvalidValueError``."""
    if reached >= iterations:
        allowed = f"{path} has {reached} iterations already, and they count: more than these"
        raise InvalidValueError("iterations", iterations, allowed)


def begin_from_policy(runner: Runner, start: PolicyStart, critic_iterations: int) -> None:
    """Put a policy into a new run, at the policy's iteration and with the whole range of speeds.

    Args:
        runner: a run that has done nothing yet.
        start: what to begin from.
        critic_iterations: for which the policy rests.

    Raises:
        SprintlabError: with these settings the policy does something else than its file.
    """
    settings, learner, done = runner.settings, runner.learner, start.policy.contract.training
    _fill(learner.actor, start.weights)
    _check_equal(learner.actor, start)
    learner.actor.std.detach().fill_(settings.ppo.noise_floor(done.iterations))
    learner.critic.normalizer.load_state_dict(learner.actor.normalizer.state_dict())
    learner.actor.normalizer.count.fill_(_ACTOR_COUNT)
    learner.critic.normalizer.count.fill_(_CRITIC_COUNT)
    learner.start_anew(_FIRST_RATE)
    runner.growth.upper = settings.stages.second_top
    runner.blend.iteration, runner.blend.progress = done.iterations, settings.stages.ramp_iterations
    if runner.environment.grid is not None:
        runner.environment.grid_weights.fill_(1.0)
    until = done.iterations + critic_iterations
    runner.take_up(Progress(done.iterations, done.environment_steps, policy_rests_until=until))


class PolicyRest:
    """Everything of the actor but its decoder, as it was when the rest began, put back after each update.

    Args:
        learner: whose actor rests.
        until: the iteration of the run at which the rest ends.
    """

    def __init__(self, learner: EstimatorPpo, until: int) -> None:
        self._learner, self._until = learner, until
        self._kept = {name: value.clone() for name, value in self._resting().items()}

    def _resting(self) -> dict[str, torch.Tensor]:
        state = self._learner.actor.state_dict()
        return {name: value for name, value in state.items() if not name.startswith(_DECODER)}

    def after(self, iteration: int) -> bool:
        """Put the policy back after an iteration; at the end of the rest the optimizers start anew.

        Returns:
            Whether the rest goes on.
        """
        for name, value in self._resting().items():
            value.copy_(self._kept[name])
        if iteration < self._until:
            return True
        self._learner.start_anew(_RATE_AFTER_REST)
        return False


def _shapes(settings: TrainingSettings, joints: int) -> dict[str, tuple[int, ...]]:
    """What the file must hold for networks of these settings."""
    observation, estimator = settings.observation.for_joints(joints), settings.estimator
    known, features = observation.frame_size + ESTIMATE_SIZE, estimator.encoder[-1]
    layers = {
        **_layers("estimator.encoder.0", (observation.input_size, *estimator.encoder)),
        "estimator.estimate_head": (ESTIMATE_SIZE, features),
        "estimator.mean_head": (estimator.latent, features),
        **_layers("policy", (known + estimator.latent, *settings.ppo.hidden, joints)),
    }
    weights = {f"{name}.weight": shape for name, shape in layers.items()}
    biases = {f"{name}.bias": shape[:1] for name, shape in layers.items()}
    return {"normalizer.mean": (known,), "normalizer.variance": (known,), **weights, **biases}


def _layers(name: str, sizes: Sequence[int]) -> dict[str, tuple[int, int]]:
    """Rows and columns of a perceptron's layers, between which the activations are counted too."""
    return {f"{name}.{2 * n}": (rows, columns) for n, (columns, rows) in enumerate(itertools.pairwise(sizes))}


def _read_weights(
    path: Path, content: bytes, shapes: dict[str, tuple[int, ...]]
) -> dict[str, npt.NDArray[np.float32]]:
    """The initializers of these names; the variance is within the constant by which the network divides."""
    import onnx

    graph = onnx.load_from_string(content).graph
    found: Any = {each.name: onnx.numpy_helper.to_array(each) for each in graph.initializer}
    centred = {n.output[0] for n in graph.node if n.op_type == "Sub" and n.input[1] == "normalizer.mean"}
    divisors = [n.input[1] for n in graph.node if n.op_type == "Div" and n.input[0] in centred]
    if len(divisors) == 1 and divisors[0] in found:
        found["normalizer.variance"] = np.square(found[divisors[0]].astype(np.float64) - NORMALIZER_FLOOR)
    for name, shape in shapes.items():
        if name not in found:
            raise PolicyFileError(f"{path}: its network has no {name}: it cannot be trained further")
        if found[name].shape != shape:
            raise SprintlabError(f"{path}: {name} is {found[name].shape}, but {shape} with these settings")
    return {name: found[name].astype(np.float32) for name in shapes}


def _fill(actor: Actor, weights: dict[str, npt.NDArray[np.float32]]) -> None:
    """Copy into the actor's tensors, which keep the zeros in the columns that fill up a first layer."""
    import torch

    state = actor.state_dict()
    for name, value in weights.items():
        state[name][tuple(slice(size) for size in value.shape)] = torch.tensor(
            value, device=state[name].device
        )


def _check_equal(actor: Actor, start: PolicyStart) -> None:
    """Refuse settings, e.g. the estimate's scales, with which the weights mean something else."""
    from sprintlab.training.runs.export import compare_on_random_inputs

    try:
        compare_on_random_inputs(copy.deepcopy(actor).cpu(), start.policy)
    except PolicyFileError as error:
        raise SprintlabError(f"{start.path} does something else with these settings: {error}") from error
