import mujoco
import numpy as np
import pytest
from numpy.testing import assert_allclose

from sprintlab.robots import ModelOptions, build_model
from sprintlab.viewer.meshes import box, capsule, cylinder, robot_surfaces


def enclosed_volume(mesh):
    """By the divergence theorem; negative when the faces look inwards."""
    a, b, c = mesh[0][mesh[1]].transpose(1, 0, 2)
    return float(np.einsum("ij,ij->", a, np.cross(b, c))) / 6.0


@pytest.mark.parametrize(
    ("mesh", "volume", "share"),
    [
        (box(np.array([1.0, 2.0, 3.0])), 48.0, 1.0),
        (cylinder(0.5, 2.0), np.pi, 0.98),
        (capsule(0.5, 2.0), np.pi + np.pi / 6.0, 0.96),
        (capsule(2.0, 0.0), 32.0 * np.pi / 3.0, 0.96),
    ],
    ids=["box", "cylinder", "capsule", "sphere"],
)
def test_primitives_are_closed_and_look_outwards(mesh, volume, share):
    assert share * volume - 1e-9 <= enclosed_volume(mesh) <= volume * (1.0 + 1e-9)


def test_every_body_with_geoms_has_a_surface(robot):
    model = build_model(robot, ModelOptions(visuals=True))
    surfaces = robot_surfaces(model)
    dressed = {model.body(model.geom_bodyid[geom]).name for geom in range(model.ngeom)} - {"world"}
    assert {surface.body for surface in surfaces} == dressed
    for surface in surfaces:
        assert surface.faces.max() < len(surface.vertices)
        assert np.isfinite(surface.vertices).all()
        assert enclosed_volume((surface.vertices, surface.faces)) > 0.0


def test_geoms_are_turned_and_moved_as_mujoco_does():
    text = """<mujoco><worldbody><body name="b"><freejoint/>
      <geom type="cylinder" size="0.1 0.5" pos="1 2 3" euler="90 0 0" group="2"/>
      </body></worldbody></mujoco>"""
    model = mujoco.MjModel.from_xml_string(text)
    (surface,) = robot_surfaces(model)
    # The cylinder's axis z, turned by 90 degrees about x, is -y.
    assert_allclose(surface.vertices.max(axis=0), [1.1, 2.5, 3.1], atol=1e-6)
    assert_allclose(surface.vertices.min(axis=0), [0.9, 1.5, 2.9], atol=1e-6)
