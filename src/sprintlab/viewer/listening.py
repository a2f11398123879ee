"""Where a page can be served: checked before a server tries, which may try for ever."""

from __future__ import annotations

import errno
import socket

from sprintlab.core.errors import SprintlabError

MOST_TRIES = 100
"""So many ports are tried, one after the other."""


def free_port(host: str, first: int) -> int:
    """The first port from ``first`` on that is free, at every address of a host.

    Raises:
        SprintlabError: the host is unknown or no interface of this machine, the port is not for everybody,
            or none is free.
    """
    last = min(first + MOST_TRIES - 1, 65535)
    for port in range(first, last + 1):
        try:
            _try(host, port)
        except OSError as error:
            if error.errno == errno.EADDRINUSE:
                continue
            reason = error.strerror or str(error)
            raise SprintlabError(f"cannot listen at {host!r}, port {port}: {reason}") from error
        except UnicodeError as error:
            raise SprintlabError(f"cannot listen at {host!r}: it is no name of a host") from error
        return port
    raise SprintlabError(f"ports {first} to {last} at {host} are all in use; name another with --port")


def _try(host: str, port: int) -> None:
    """Listen for a moment at every address of a host; raises ``OSError`` as the system does."""
    for family, _, _, _, address in socket.getaddrinfo(host, port, type=socket.SOCK_STREAM):
        with socket.socket(family, socket.SOCK_STREAM) as server:
            server.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            if family == socket.AF_INET6:  # as asyncio: the same port of IPv4 is asked for on its own
                server.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_V6ONLY, 1)
            server.bind(address)
            server.listen(1)
