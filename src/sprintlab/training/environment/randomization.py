"""What differs from one environment to the next: drawn once, written into the simulator's memory."""

from __future__ import annotations

import math

import torch

from sprintlab.commands.state import GRAVITY
from sprintlab.robots import effective_leg_mass, friction_ratio, pair_parameters
from sprintlab.training.environment.feet import contact_laws
from sprintlab.training.environment.simulation import BatchSimulation
from sprintlab.training.settings import RandomizationSettings


def _uniform(n: int, low: float, high: float, device: str, *columns: int) -> torch.Tensor:
    return low + (high - low) * torch.rand(n, *columns, device=device)


def randomize(simulation: BatchSimulation, settings: RandomizationSettings) -> torch.Tensor:
    """Draw every environment's robot and ground, from PyTorch's global generator.

    Returns:
        Foot friction of each environment ``(n,)``.
    """
    n, device = simulation.environments, simulation.device
    friction = _uniform(n, *settings.friction, device)
    simulation.fields["pair_friction"][:, :, :2] = friction[:, None, None]
    _randomize_feet(simulation, settings)
    simulation.timestep.mul_(_uniform(n, *settings.clock, device))
    simulation.drag_area.copy_(_uniform(n, *settings.drag_area, device))
    _randomize_trunk(simulation, settings)
    for gain in (simulation.stiffness, simulation.damping):
        gain.mul_(_uniform(n, 1 - settings.gain, 1 + settings.gain, device, gain.shape[1]))
    strength = _uniform(n, 1 - settings.strength, 1 + settings.strength, device, simulation.strength.shape[1])
    simulation.strength.copy_(strength)
    simulation.voltage.mul_(_uniform(n, *settings.bus_voltage, device))
    simulation.resistance_factor.copy_(_uniform(n, *settings.resistance, device))
    simulation.friction_factor.copy_(_uniform(n, *settings.dry_friction, device))
    simulation.mean_delay.copy_(_uniform(n, *settings.delay, device) / simulation.settings.timestep)
    if settings.slope:  # last: no other draw depends on it
        simulation.tilt(torch.atan(_uniform(n, -settings.slope, settings.slope, device)))
    return friction


def _randomize_feet(simulation: BatchSimulation, settings: RandomizationSettings) -> None:
    """Stiffness and restitution of the pads, alike on a robot's four feet."""
    n, model = simulation.environments, simulation.mj_model
    low, high = settings.foot_stiffness
    stiffness = _uniform(n, math.log(low), math.log(high), "cpu").exp().double().numpy()
    restitution = _uniform(n, *settings.foot_restitution, "cpu").double().numpy()
    timestep = simulation.settings.timestep
    law = contact_laws(stiffness, restitution, effective_leg_mass(model), timestep)
    ratio = torch.as_tensor(friction_ratio(law), dtype=torch.float32, device=simulation.device)
    simulation.friction_ratio_invsqrt.copy_(ratio.rsqrt())
    for pair, geom in enumerate(model.pair_geom2):
        inverse_weight = float(model.body_invweight0[model.geom_bodyid[geom], 0])
        for name, values in pair_parameters(law, inverse_weight, timestep)._asdict().items():
            field = simulation.fields[f"pair_{name}"]
            field[:, pair] = torch.as_tensor(values, dtype=field.dtype, device=field.device)


def _randomize_trunk(simulation: BatchSimulation, settings: RandomizationSettings) -> None:
    """Payload at the trunk's centre, and a shifted centre of mass."""
    n, device = simulation.environments, simulation.device
    trunk = int(simulation.mj_model.body("trunk").id)
    payload = _uniform(n, *settings.payload, device)
    for field in ("body_mass", "body_subtreemass"):
        simulation.fields[field][:, trunk] += payload
    simulation.fields["body_subtreemass"][:, 0] += payload
    simulation.monitor.weight += GRAVITY * payload
    shift = _uniform(n, -settings.center_of_mass, settings.center_of_mass, device, 3)
    simulation.fields["body_ipos"][:, trunk] += shift
