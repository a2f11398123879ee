"""Feet that differ from environment to environment: the contact law of many pads at once."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sprintlab.core.array_types import FloatArray
from sprintlab.robots import ContactLaw, FootContact, contact_law

_NODES = 5  # of the table, along stiffness and along restitution


def contact_laws(stiffness: FloatArray, restitution: FloatArray, mass: float, timestep: float) -> ContactLaw:
    """The contact law of every pad, between the nodes of a table of ``contact_law``.

    Args:
        stiffness: ``(n,)`` [N/m].
        restitution: ``(n,)`` [-].
        mass: the leg's effective mass [kg].
        timestep: [s].

    Returns:
        A law with fields ``(n,)``.
    """
    logarithm = np.log(stiffness)
    rows, columns = _nodes(logarithm), _nodes(restitution)
    table = np.array([[_logarithms(row, column, mass, timestep) for column in columns] for row in rows])
    i, right = _place(rows, logarithm)
    j, up = _place(columns, restitution)
    right, up = right[:, None], up[:, None]
    below = (1.0 - right) * table[i, j] + right * table[i + 1, j]
    above = (1.0 - right) * table[i, j + 1] + right * table[i + 1, j + 1]
    laws = np.exp((1.0 - up) * below + up * above)
    return ContactLaw(stiffness=laws[:, 0], damping=laws[:, 1], added_mass=laws[:, 2])


def _nodes(values: FloatArray) -> FloatArray:
    """Between the least and the greatest value; two where all are the same."""
    low, high = float(values.min()), float(values.max())
    return np.linspace(low, high, _NODES) if high > low else np.array((low, low))


def _logarithms(stiffness: float, restitution: float, mass: float, timestep: float) -> list[float]:
    pad = FootContact(stiffness=float(np.exp(stiffness)), restitution=float(restitution))
    law = contact_law(pad, mass, timestep)
    return [float(np.log(value)) for value in (law.stiffness, law.damping, law.added_mass)]


def _place(nodes: FloatArray, values: FloatArray) -> tuple[NDArray[np.int64], FloatArray]:
    """Cell and share of it of each value ``(n,)``."""
    cell = np.clip(np.searchsorted(nodes, values) - 1, 0, len(nodes) - 2)
    width = nodes[cell + 1] - nodes[cell]
    return cell, (values - nodes[cell]) / np.where(width > 0.0, width, 1.0)
