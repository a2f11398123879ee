"""The live page: a robot in the browser, knobs and plots beside it, drawn by viser."""

from __future__ import annotations

import io
import math
import socket
import time
from collections import deque
from collections.abc import Callable
from contextlib import redirect_stdout, suppress
from pathlib import Path
from queue import SimpleQueue

import viser

from sprintlab.core.checks import check_positive, check_range
from sprintlab.core.errors import SprintlabError
from sprintlab.viewer.controls import Controls
from sprintlab.viewer.gamepad import Gamepad
from sprintlab.viewer.live import Session, Snapshot
from sprintlab.viewer.plots import Plots
from sprintlab.viewer.scene import Scene

FRAME_RATE = 30.0
"""Pictures a second [Hz]."""

PLOT_EVERY = 4
"""The plots are redrawn with every such picture."""

_OWN_NAMES = {"0.0.0.0": "localhost", "::": "localhost"}  # all interfaces: no address to open
_LONGEST_ADVANCE = 0.1  # simulated seconds in one picture, however late it is


def check_host(host: str) -> None:
    """Refuse a host that is unknown or no interface of this machine: a server would try for ever.

    Raises:
        SprintlabError: as said.
    """
    try:
        for family, _, _, _, (address, *_) in socket.getaddrinfo(host, None, type=socket.SOCK_STREAM):
            with socket.socket(family, socket.SOCK_STREAM) as server:
                server.bind((address, 0))
    except (OSError, UnicodeError) as error:
        raise SprintlabError(f"cannot listen at {host!r}: {error}") from error


class PaceMeter:
    """How many simulated seconds pass in a second, over the last one."""

    def __init__(self) -> None:
        self._moments: deque[tuple[float, float]] = deque()

    def after(self, simulated: float, clock: float) -> float:
        """The pace up to now; both times are in seconds and never fall."""
        self._moments.append((simulated, clock))
        while self._moments[0][1] < clock - 1.0:
            self._moments.popleft()
        first_simulated, first_clock = self._moments[0]
        return (simulated - first_simulated) / max(clock - first_clock, 1e-3)


class Page:
    """A session in the browser.

    Args:
        session: the robot that runs.
        host: interface to listen on; ``localhost`` keeps it on this machine.
        port: first port to try.
        duration: stop after this time [s]; ``None`` runs until interrupted.
        gamepad: joystick device that moves the sliders too.

    Raises:
        InvalidValueError: port or duration is out of range.
        JoystickError: the gamepad cannot be read.
        SprintlabError: the page cannot be served there.
    """

    def __init__(
        self,
        session: Session,
        host: str = "localhost",
        port: int = 8080,
        duration: float | None = None,
        gamepad: Path | None = None,
    ) -> None:
        check_range("port", port, 1, 65535)
        if duration is not None:
            check_positive("duration", duration, "s")
        check_host(host)
        self.session, self._host = session, host
        self._duration = math.inf if duration is None else duration
        self._pad = None if gamepad is None else Gamepad(gamepad)
        self._pad_shown = ""
        self._actions: SimpleQueue[Callable[[], object]] = SimpleQueue()
        self._owed = 0.0
        self._ended = False
        self._pace = PaceMeter()
        # viser's banner is not shown: the command says where the page is.
        with redirect_stdout(io.StringIO()):
            self.server = viser.ViserServer(host=host, port=port, label="sprintlab play", verbose=False)
        self._scene = Scene(self.server, session)
        self.server.gui.configure_theme(control_width="medium", show_logo=False, show_share_button=False)
        self._plots = Plots(self.server, session.robot)
        self._controls = Controls(self.server, session, self._actions.put, self._scene.find_robot)

    @property
    def address(self) -> str:
        """What to open in a browser on this machine."""
        host = _OWN_NAMES.get(self._host, self._host)
        return f"http://{f'[{host}]' if ':' in host else host}:{self.server.get_port()}"

    def run(self) -> None:
        """Simulate and draw until the duration is over or ``end`` is called.

        The server stops at the end, interrupted or not.
        """
        started = last = time.perf_counter()
        picture = 0
        try:
            while not self._ended and last - started < self._duration:
                now = time.perf_counter()
                self._follow_pad()
                self._take_actions()
                self._show(self._advance(now - last), picture)
                picture, last = picture + 1, now
                time.sleep(max(0.0, 1.0 / FRAME_RATE - (time.perf_counter() - now)))
        finally:
            if self._pad is not None:
                self._pad.close()
            with redirect_stdout(io.StringIO()):
                self.server.stop()

    def end(self) -> None:
        """Let ``run`` return after the present picture; any thread may ask for it."""
        self._ended = True

    def _follow_pad(self) -> None:
        if self._pad is None:
            return
        self._controls.follow(self._pad.read())
        state = f"{self._pad.name} {self._pad.connected}"
        if state != self._pad_shown:
            self._pad_shown = state
            self._controls.show_pad(self._pad)

    def _take_actions(self) -> None:
        while not self._actions.empty():
            with suppress(SprintlabError):
                self._actions.get_nowait()()

    def _advance(self, wall_time: float) -> Snapshot:
        """Let the simulation catch up with the clock, as far as one picture may take it."""
        rate, pace = self.session.plant.options.motor_rate, self._controls.pace
        self._owed = min(self._owed + pace * wall_time, _LONGEST_ADVANCE) if pace else 0.0
        steps = int(self._owed * rate)
        self._owed -= steps / rate
        return self.session.advance(steps)

    def _show(self, snapshot: Snapshot, picture: int) -> None:
        if self._controls.pace:
            self._plots.add(snapshot)
        with self.server.atomic():
            self._scene.show(self.session.knobs.slope)
        pace = self._pace.after(snapshot.time, time.perf_counter())
        if picture % PLOT_EVERY == 0:
            self._plots.draw(snapshot, self.session.knobs, pace)
