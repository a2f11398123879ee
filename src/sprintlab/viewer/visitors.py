"""What a visitor of the live page may say to it: what its controls and its camera say, and nothing else.

viser alone obeys much more: it writes any attribute of a control, keeps what is uploaded, and opens a tunnel
through which the page is on the Internet.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Awaitable, Callable
from typing import Any, Literal

import msgspec
import viser

LARGEST_MESSAGE = 1 << 16
"""Bytes that a visitor may say at once; a control says a hundred."""

MOST_VISITORS = 32
"""At once: what they do not take of the page waits in memory."""

_PROTOCOL = f"viser-v{viser.__version__}"


class _Control(msgspec.Struct, tag="GuiUpdateMessage"):
    uuid: str
    updates: dict[Literal["value"], bool | int | float | str]


class _Key(msgspec.Struct, tag="CommandTriggerMessage"):
    uuid: str


class _Camera(msgspec.Struct, tag="ViewerCameraMessage"):
    wxyz: tuple[float, float, float, float]
    position: tuple[float, float, float]
    look_at: tuple[float, float, float]
    up_direction: tuple[float, float, float]
    fov: float
    near: float
    far: float
    image_height: float
    image_width: float


def is_offered(content: str | bytes) -> bool:
    """Whether a message is one that the page's controls or its camera send."""
    if isinstance(content, str):
        return False
    try:
        msgspec.msgpack.decode(content, type=_Control | _Key | _Camera)
    except (msgspec.MsgspecError, ValueError, RecursionError):
        return False
    return True


def silent_log() -> logging.Logger:
    """For a server: what goes wrong with a visitor is not shown to who serves the page."""
    log = logging.getLogger(__name__)
    log.addHandler(logging.NullHandler())
    log.propagate = False
    return log


class Visitors:
    """Hears what visitors of a page may say.

    Args:
        handler: the server's, for one connection.
    """

    def __init__(self, handler: Callable[[Any], Awaitable[None]]) -> None:
        self._handler, self._here = handler, 0

    async def __call__(self, connection: Any) -> None:
        """Let the server talk with one visitor, unless there are too many or it speaks otherwise."""
        asyncio.get_running_loop().set_exception_handler(lambda loop, context: None)  # as the silent log
        if self._here >= MOST_VISITORS:
            await connection.close(1013, "too many visitors")
            return
        if connection.subprotocol != _PROTOCOL:  # of which the server would tell, in the visitor's words
            await connection.close(1002, f"another version than this page's, {viser.__version__}: reload it")
            return
        connection.recv = _only_offered(connection.recv)
        self._here += 1
        try:
            await self._handler(connection)
        finally:
            self._here -= 1


def _only_offered(hear: Callable[[], Awaitable[str | bytes]]) -> Callable[[], Awaitable[str | bytes]]:
    async def hear_offered() -> str | bytes:
        while not is_offered(said := await hear()):
            pass
        return said

    return hear_offered
