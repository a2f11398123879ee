import socket

import pytest

from sprintlab.core.errors import SprintlabError
from sprintlab.viewer.listening import free_port


@pytest.fixture
def taken():
    """A port that somebody listens at."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        yield server.getsockname()[1]


def test_a_port_in_use_is_passed_over(taken):
    assert free_port("127.0.0.1", taken) > taken


def test_a_free_port_is_taken_and_stays_free(taken):
    port = free_port("127.0.0.1", taken)
    assert free_port("127.0.0.1", port) == port


@pytest.mark.parametrize("host", ["no such host", "8.8.8.8"])
def test_hosts_that_are_not_here_are_refused_at_once(host):
    with pytest.raises(SprintlabError, match="cannot listen at"):
        free_port(host, 8080)


def test_no_port_left_is_refused(monkeypatch):
    with socket.create_server(("127.0.0.1", 0)) as server:
        monkeypatch.setattr("sprintlab.viewer.listening.MOST_TRIES", 1)
        with pytest.raises(SprintlabError, match="all in use"):
            free_port("127.0.0.1", server.getsockname()[1])
