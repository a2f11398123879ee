import pytest

from sprintlab.robots import load_robot
from sprintlab.speed_limit import SearchSettings, fastest_stride, runner_from_robot

QUICK = SearchSettings(starts=2)


@pytest.fixture(scope="session", params=["bp2", "go1"])
def runner(request):
    return runner_from_robot(load_robot(request.param))


@pytest.fixture(scope="session")
def bp2():
    return runner_from_robot(load_robot("bp2"))


@pytest.fixture(scope="session")
def fastest(bp2):
    """BP2's limit by a short search."""
    return fastest_stride(bp2, QUICK)
