"""A robot's MJCF or URDF file, compiled by MuJoCo without the meshes that decide nothing."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from pathlib import Path

import mujoco
import numpy as np

from sprintlab.core.errors import RobotModelError, SprintlabError, printable
from sprintlab.core.reading import read_text

MODEL_LIMIT = 16 << 20
"""Largest model file that is read [bytes]."""
_FARTHEST = 1e6  # m
_ROUNDING = 1e-6  # relative; files are written with six or seven digits


def compiled(path: Path) -> tuple[mujoco.MjModel, tuple[str, ...]]:
    """The compiled file, and the links whose inertia had to be corrected for it."""
    text = read_text(path, MODEL_LIMIT, what="robot model", error=RobotModelError)
    try:
        return _compile(path, text)
    except (ElementTree.ParseError, ValueError, SprintlabError, mujoco.FatalError) as error:
        reason = " ".join(str(error).split()) or type(error).__name__
        raise RobotModelError(f"robot model {path} cannot be used: {printable(reason)}") from error


def _compile(path: Path, text: str) -> tuple[mujoco.MjModel, tuple[str, ...]]:
    root = ElementTree.fromstring(text)
    corrected = possible_inertias(root)
    if root.tag == "robot":
        spec = mujoco.MjSpec.from_string(_plain_urdf(root))
    else:
        spec = mujoco.MjSpec.from_file(str(path))
    _drop_meshes(spec)
    model = spec.compile()
    if not all(
        (np.abs(places) < _FARTHEST).all() for places in (model.body_pos, model.body_ipos, model.geom_pos)
    ):
        raise ValueError("a position in it is not a finite number")
    return model, corrected


def possible_inertias(root: ElementTree.Element) -> tuple[str, ...]:
    """Raise inertias of a URDF's links that no body can have, in place: published files hold some.

    A body's principal inertias are not negative, and no two add up to less than the third. Where they do, the
    same amount is added to all three: the least that helps and keeps the axes.

    Returns:
        Names of the links that were changed.
    """
    changed = []
    for link in root.findall("link"):
        entries = link.find("inertial/inertia")
        if entries is None:
            continue
        xx, yy, zz, xy, xz, yz = (
            float(entries.get(name, 0.0)) for name in ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
        )
        if not all(abs(value) < 1e12 for value in (xx, yy, zz, xy, xz, yz)):
            raise ValueError(f"link {link.get('name', '?')} has an inertia that is no finite number")
        low, middle, high = np.linalg.eigvalsh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        lack = max(high - low - middle, -low)
        if lack > _ROUNDING * abs(high):
            for name, value in (("ixx", xx), ("iyy", yy), ("izz", zz)):
                entries.set(name, repr(float(value + (1.0 + _ROUNDING) * lack)))
            changed.append(link.get("name", "?"))
    return tuple(changed)


def _plain_urdf(root: ElementTree.Element) -> str:
    """A URDF without meshes whose links stay apart, so that a foot keeps its name and its mass."""
    for link in root.iter("link"):
        for shape in [*link.findall("visual"), *link.findall("collision")]:
            if shape.tag == "visual" or shape.find("geometry/mesh") is not None:
                link.remove(shape)
    for joint in root.findall("joint"):
        if joint.get("type") == "floating":  # the base's: it is found by its legs, and may as well stand
            joint.set("type", "fixed")
    for extension in root.findall("mujoco"):
        root.remove(extension)
    extension = ElementTree.SubElement(root, "mujoco")
    # A URDF link without <inertial> weighs nothing: its shapes are not to be weighed as water.
    settings = {"fusestatic": "false", "balanceinertia": "false", "inertiafromgeom": "false"}
    ElementTree.SubElement(extension, "compiler", settings)
    return ElementTree.tostring(root, encoding="unicode")


def _drop_meshes(spec: mujoco.MjSpec) -> None:
    """Take out mesh shapes where the body's inertia does not depend on them, then unused meshes."""
    for body in spec.bodies:
        for geom in list(body.geoms):
            if geom.type == mujoco.mjtGeom.mjGEOM_MESH and body.explicitinertial:
                spec.delete(geom)
    used = {geom.meshname for geom in spec.geoms if geom.type == mujoco.mjtGeom.mjGEOM_MESH}
    for mesh in list(spec.meshes):
        if mesh.name not in used:
            spec.delete(mesh)
