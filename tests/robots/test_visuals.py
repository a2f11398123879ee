import pytest

from sprintlab.robots import ModelOptions, build_model, load_robot


@pytest.fixture(scope="module")
def dressed():
    return build_model(load_robot("bp2"), ModelOptions(visuals=True))


def test_every_link_is_dressed_and_touches_nothing(dressed):
    visual = dressed.geom_group == 2
    assert not dressed.geom_contype[visual].any() and not dressed.geom_conaffinity[visual].any()
    assert set(dressed.geom_bodyid[visual].tolist()) == set(range(1, dressed.nbody))
