"""What differs from one environment to the next: drawn once, written into the engine's parameters."""

from __future__ import annotations

import math
from typing import NamedTuple

import torch

from sprintlab.commands.state import GRAVITY
from sprintlab.engine import Engine
from sprintlab.training.settings import RandomizationSettings


class Drawn(NamedTuple):
    """What the environment needs to know of the draws ``(n,)``.

    Attributes:
        slope: angle by which the ground rises along x [rad].
        delay: mean delay of the joint targets [substeps].
    """

    slope: torch.Tensor
    delay: torch.Tensor


def randomize(engine: Engine, settings: RandomizationSettings) -> Drawn:
    """Draw every environment's robot and ground, from PyTorch's global generator."""

    def uniform(low: float, high: float, *columns: int) -> torch.Tensor:
        return low + (high - low) * torch.rand(engine.robots, *columns, device=engine.device)

    joints = engine.stiffness.shape[1]
    engine.friction.copy_(uniform(*settings.friction))
    softest, stiffest = settings.foot_stiffness
    stiffness = uniform(math.log(softest), math.log(stiffest)).exp()
    engine.draw_pads(stiffness, uniform(*settings.foot_restitution))
    engine.timestep.mul_(uniform(*settings.clock))
    engine.drag_area.copy_(uniform(*settings.drag_area))
    payload = uniform(*settings.payload)
    engine.trunk_mass.add_(payload)
    engine.weight.add_(GRAVITY * payload)
    engine.trunk_center.add_(uniform(-settings.center_of_mass, settings.center_of_mass, 3))
    for gain in (engine.stiffness, engine.damping):
        gain.mul_(uniform(1 - settings.gain, 1 + settings.gain, joints))
    engine.strength.copy_(uniform(1 - settings.strength, 1 + settings.strength, joints))
    engine.voltage.mul_(uniform(*settings.bus_voltage))
    engine.resistance_factor.copy_(uniform(*settings.resistance))
    engine.friction_factor.copy_(uniform(*settings.dry_friction))
    slope = torch.atan(uniform(-settings.slope, settings.slope))
    engine.tilt(slope)
    return Drawn(slope, uniform(*settings.delay) / engine.options.timestep)
