import socket

import pytest

from sprintlab.core.errors import SprintlabError
from sprintlab.viewer.listening import free_port


def test_a_port_in_use_is_passed_over():
    with socket.create_server(("127.0.0.1", 0)) as server:
        taken = server.getsockname()[1]
        assert free_port("127.0.0.1", taken) > taken


@pytest.mark.parametrize("host", ["no such host", "8.8.8.8"])
def test_hosts_that_are_not_here_are_refused_at_once(host):
    with pytest.raises(SprintlabError, match="cannot listen at"):
        free_port(host, 8080)
