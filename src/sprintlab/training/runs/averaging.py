"""One policy from several checkpoints: the mean of their weights.

Networks that began with the same training lie in one valley of the loss: their mean is a policy too, and a
steadier one than each of them (Izmailov et al. 2018, "Averaging weights leads to wider optima and better
generalization"; Wortsman et al. 2022, "Model soups"). Networks that began from different random weights have
no such mean.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import torch

from sprintlab.control.pace import PaceContract
from sprintlab.control.turning import TurningContract
from sprintlab.core.checks import check_positive
from sprintlab.core.errors import InvalidValueError, SprintlabError
from sprintlab.core.files import check_writable_file
from sprintlab.training.runs.checkpoint import read_checkpoint
from sprintlab.training.runs.export import ExportedPolicy, actor_from_checkpoint, export_state


def average_checkpoints(
    checkpoints: Sequence[Path],
    output: Path,
    shares: Sequence[float] | None = None,
    pace: PaceContract | None = None,
    turning: TurningContract | None = None,
) -> ExportedPolicy:
    """Write the policy whose weights are the mean of these checkpoints'.

    Its contract is that of the last one: settings, iterations and command line.

    Args:
        checkpoints: of one training, or of trainings that went on from it; milestones will do.
        output: the file to write; it appears only if it reads back equal.
        shares: of each checkpoint in the mean, over their sum; equal when left out.
        pace: how far the forward command that reaches the network may run ahead of the robot, and how fast
            it may fall; as it is given when left out.
        turning: which yaw rate the network is asked for; the one that is commanded when left out.

    Raises:
        InvalidValueError: fewer than two checkpoints, or shares that are not one positive number for each.
        SprintlabError: one cannot be read, or is of another robot or of networks of other sizes.
        PolicyFileError: the runtimes differ.
    """
    if len(checkpoints) < 2:
        raise InvalidValueError("checkpoints", len(checkpoints), "at least two")
    parts = _parts(shares, len(checkpoints))
    check_writable_file(output)
    states = [read_checkpoint(path) for path in checkpoints]
    last, weights = states[-1], [actor_from_checkpoint(state).state_dict() for state in states]
    for path, state, found in zip(checkpoints, states, weights, strict=True):
        if state["settings"].robot != last["settings"].robot or _sizes(found) != _sizes(weights[-1]):
            raise SprintlabError(f"{path} is of another robot or other networks than {checkpoints[-1]}")
    mean = {
        name: sum(found[name] * part for found, part in zip(weights, parts, strict=True))
        for name in weights[-1]
    }
    return export_state({**last, "learner": {"actor": mean}}, output, pace, turning)


def _parts(shares: Sequence[float] | None, count: int) -> tuple[float, ...]:
    """Shares that sum to one."""
    chosen = (1.0,) * count if shares is None else tuple(shares)
    if len(chosen) != count:
        raise InvalidValueError("shares", chosen, f"one for each of {count} checkpoints")
    for share in chosen:
        check_positive("shares", share)
    return tuple(share / sum(chosen) for share in chosen)


def _sizes(weights: dict[str, torch.Tensor]) -> dict[str, Any]:
    return {name: value.shape for name, value in weights.items()}
