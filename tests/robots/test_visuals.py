import mujoco
import numpy as np
import pytest

from sprintlab.robots import ModelOptions, build_model, load_robot


@pytest.fixture(scope="module")
def dressed():
    return build_model(load_robot("bp2"), ModelOptions(visuals=True))


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
