"""Who may open a WebSocket of the live page: the page itself, and no other page in the same browser."""

from __future__ import annotations

import ipaddress
import re
from collections.abc import Callable, Generator
from contextlib import contextmanager
from typing import Any

import websockets.asyncio.server

from sprintlab.viewer.visitors import LARGEST_MESSAGE, Visitors, silent_log

_LOCAL_NAMES = ("localhost",)
_HOST = re.compile(r"(?:\[([0-9a-f:.]+)\]|([^\[\]:@/]+))(?::[0-9]{1,5})?")
"""A host of a URL: an address in brackets or a name, and perhaps a port."""


def is_own_origin(origin: str, host: str, served_at: str) -> bool:
    """Whether a WebSocket was opened by the page that this server serves.

    A name other than the one that is served is refused even where origin and host agree: whoever owns that
    name can let it lead to this machine.

    Args:
        origin: the request's header of that name; empty if there is none.
        host: the same.
        served_at: the host that the page is served at, as the user gave it.
    """
    return origin.lower() in (f"http://{host.lower()}", f"https://{host.lower()}") and _is_own_name(
        host, served_at
    )


def _is_own_name(host: str, served_at: str) -> bool:
    parts = _HOST.fullmatch(host.lower())
    if parts is None:
        return False
    name = parts[1] or parts[2]
    if name in (*_LOCAL_NAMES, served_at.lower()):
        return True
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True


@contextmanager
def own_origin_only(served_at: str) -> Generator[None, None, None]:
    """Servers of WebSockets that start in the block refuse what another page opens, with status 403.

    Of what the page itself opens they hear what its controls say.
    """
    serve = websockets.asyncio.server.serve

    def guarded(
        handler: Callable[..., Any],
        *arguments: Any,
        process_request: Callable[..., Any] | None = None,
        **options: Any,
    ) -> Any:
        def judge(connection: Any, request: Any) -> Any:
            headers = request.headers
            if headers.get_all("Upgrade"):
                origins, hosts = headers.get_all("Origin"), headers.get_all("Host")
                if not (len(origins) == len(hosts) == 1 and is_own_origin(origins[0], hosts[0], served_at)):
                    return connection.respond(403, "This page takes its own connections only.\n")
            try:
                return None if process_request is None else process_request(connection, request)
            except OSError:  # a name that is too long for a disk
                return connection.respond(404, "There is no such page.\n")

        options |= {"max_size": LARGEST_MESSAGE, "logger": silent_log()}
        return serve(Visitors(handler), *arguments, process_request=judge, **options)

    websockets.asyncio.server.serve = guarded  # pyright: ignore[reportAttributeAccessIssue]
    try:
        yield
    finally:
        websockets.asyncio.server.serve = serve
