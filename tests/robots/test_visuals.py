import math

import mujoco
import numpy as np
import pytest

from sprintlab.robots import ModelOptions, build_model, load_robot
from sprintlab.robots.visuals import loft


@pytest.fixture(scope="module")
def dressed():
    return build_model(load_robot("bp2"), ModelOptions(visuals=True))


def test_a_loft_is_closed_and_faces_outward():
    sections = [(0.0, 0.0, z, 2.0, 1.0) for z in (0.0, 1.0, 3.0)]
    vertices, faces = loft(sections, (1.0, 0.0, 0.0), (0.0, 1.0, 0.0))
    area = 4.0 * 2.0 * 1.0 * math.gamma(1.0 + 1.0 / 2.4) ** 2 / math.gamma(1.0 + 2.0 / 2.4)
    corners = vertices[faces]
    volume = np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])).sum() / 6.0
    assert volume == pytest.approx(3.0 * area, rel=0.01)
    edges = np.vstack([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    directed = {tuple(edge) for edge in edges.tolist()}
    assert len(directed) == len(edges)
    assert all((b, a) in directed for a, b in directed)


def test_every_link_is_dressed_and_touches_nothing(dressed):
    visual = dressed.geom_group == 2
    assert not dressed.geom_contype[visual].any() and not dressed.geom_conaffinity[visual].any()
    assert set(dressed.geom_bodyid[visual].tolist()) == set(range(dressed.nbody))


def test_the_feet_are_drawn_where_they_touch(dressed):
    """No foot or claw hangs below its contact sphere in the default pose by more than a few millimetres."""
    data = mujoco.MjData(dressed)
    mujoco.mj_resetDataKeyframe(dressed, data, 0)
    mujoco.mj_forward(dressed, data)
    for geom in np.flatnonzero(dressed.geom_type == mujoco.mjtGeom.mjGEOM_MESH):
        mesh = dressed.geom_dataid[geom]
        start, count = dressed.mesh_vertadr[mesh], dressed.mesh_vertnum[mesh]
        rotation = data.geom_xmat[geom].reshape(3, 3)
        heights = (dressed.mesh_vert[start : start + count] @ rotation.T + data.geom_xpos[geom])[:, 2]
        assert heights.min() > -0.005
