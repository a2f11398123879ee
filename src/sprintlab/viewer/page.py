"""The live page: a robot in the browser, knobs beside it, drawn by viser.

The browser's callbacks only put actions into a queue; the loop takes them between two frames, so the
simulation is touched by one thread.
"""

# MuJoCo's compiled module has no type stubs.
# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

import io
import math
import time
from collections import deque
from collections.abc import Callable
from contextlib import redirect_stdout
from dataclasses import dataclass
from queue import Empty, SimpleQueue
from typing import Any

import numpy as np
import viser

from sprintlab.core.checks import check_positive, check_range
from sprintlab.motors import MOTOR_MODELS
from sprintlab.robots import ModelOptions, build_model
from sprintlab.viewer.envelope_plot import EnvelopePlot
from sprintlab.viewer.live import Glimpse, Session
from sprintlab.viewer.meshes import robot_surfaces

FRAME_RATE = 30.0
"""Pictures a second [Hz]."""

PLOT_EVERY = 4
"""The plots are redrawn with every such picture."""

PLOT_SECONDS = 10.0
"""Simulated time that the plots show [s]."""

PACES = {"real time": 1.0, "1/2": 0.5, "1/4": 0.25, "1/10": 0.1, "1/25": 0.04}
TOP_SPEED = 14.0

_KEYS_HINT = "Keys: W faster, S slower, A left, D right, Q straight on, X stop"
_GRID_SECTION = 5.0
_SCALES: Any = {"x": {"time": False, "auto": True}, "y": {"auto": True}}
_LONGEST_ADVANCE = 0.1  # simulated seconds in one picture, however late it is
_STYLE = """<style>
.envelope { width: 100%; display: block; margin: 2px 0; }
.envelope .axis { stroke: #868e96; stroke-width: .7; opacity: .6; fill: none; }
.envelope .real { fill: #228be6; fill-opacity: .16; stroke: #228be6; stroke-width: 1; }
.envelope .used { fill: none; stroke: #868e96; stroke-width: 1.2; stroke-dasharray: 4 3; }
.envelope .tail { fill: none; stroke-width: 1.2; opacity: .45; }
.envelope .name { font: 12px system-ui, sans-serif; fill: #868e96; }
.sprintlab { padding: 2px 14px; font: 12px system-ui, sans-serif; font-variant-numeric: tabular-nums; }
.sprintlab b { font-size: 20px; } .sprintlab td { padding-right: 16px; white-space: nowrap; }
.sprintlab .fell { color: #e03131; font-weight: 600; }
</style>"""


@dataclass(frozen=True, kw_only=True)
class PageOptions:
    """Where the page is served.

    Attributes:
        host: interface to listen on; ``localhost`` keeps it on this machine.
        port: first port to try, 1 to 65535.
        duration: stop after this time [s]; ``None`` runs until interrupted.

    Raises:
        InvalidValueError: a field is out of range.
    """

    host: str = "localhost"
    port: int = 8080
    duration: float | None = None

    def __post_init__(self) -> None:
        check_range("port", self.port, 1, 65535)
        if self.duration is not None:
            check_positive("duration", self.duration, "s")


class Page:
    """A session in the browser.

    Args:
        session: the robot that runs.
        options: where the page is served.
    """

    def __init__(self, session: Session, options: PageOptions) -> None:
        self.session = session
        self.options = options
        self._actions: SimpleQueue[Callable[[], object]] = SimpleQueue()
        self._pace, self._paused, self._owed = 1.0, False, 0.0
        self._curves: deque[tuple[float, float, float, float]] = deque()
        with redirect_stdout(io.StringIO()):  # viser's banner; the command says where the page is
            self.server = viser.ViserServer(
                host=options.host, port=options.port, label="sprintlab play", verbose=False
            )
        self.server.gui.configure_theme(control_width="large", show_logo=False, show_share_button=False)
        self._robot = _RobotView(self.server, session)
        self._envelope = EnvelopePlot(session.robot)
        self._add_panels()

    @property
    def address(self) -> str:
        """What to open in a browser."""
        return f"http://{self.options.host}:{self.server.get_port()}"

    def run(self) -> None:
        """Simulate and draw until the duration is over; the server stops at the end, interrupted or not."""
        started = last = time.perf_counter()
        picture = 0
        try:
            while self.options.duration is None or last - started < self.options.duration:
                now = time.perf_counter()
                self._take_actions()
                self._show(self._advance(now - last), picture)
                picture, last = picture + 1, now
                time.sleep(max(0.0, 1.0 / FRAME_RATE - (time.perf_counter() - now)))
        finally:
            with redirect_stdout(io.StringIO()):
                self.server.stop()

    def _take_actions(self) -> None:
        while True:
            try:
                self._actions.get_nowait()()
            except Empty:
                return

    def _advance(self, wall_time: float) -> Glimpse:
        """Let the simulation catch up with the clock, as far as one picture may take it."""
        rate = self.session.plant.options.motor_rate
        share = 0.0 if self._paused else self._pace
        self._owed = min(self._owed + share * wall_time, _LONGEST_ADVANCE) if share else 0.0
        steps = int(self._owed * rate)
        self._owed -= steps / rate
        return self.session.advance(steps)

    def _show(self, glimpse: Glimpse, picture: int) -> None:
        if not self._paused:
            self._curves.append((glimpse.time, glimpse.speed, glimpse.command[0], glimpse.bus_power / 1e3))
            while self._curves[0][0] < glimpse.time - PLOT_SECONDS:
                self._curves.popleft()
            if len(glimpse.joint_speed):
                self._last = glimpse
        with self.server.atomic():
            self._robot.show(self.session.knobs.slope)
        if picture % PLOT_EVERY == 0:
            self._show_plots(glimpse)

    def _show_plots(self, glimpse: Glimpse) -> None:
        self._status.content = _STYLE + _status_text(glimpse)
        if len(self._curves) < 2:
            return
        moment, speed, command, power = np.array(self._curves).T
        self._speed_plot.data = (moment, speed, command)
        self._power_plot.data = (moment, power)
        knobs = self.session.knobs
        drawing = self._envelope.draw(
            self._last.joint_speed, self._last.motor_torque, knobs.motor_model, knobs.bus_voltage
        )
        self._envelopes.content = f'<div class="sprintlab">{drawing}</div>'

    # --- knobs ---------------------------------------------------------------------------------------------

    def _add_panels(self) -> None:
        gui = self.server.gui
        self._status = gui.add_html(_STYLE)
        with gui.add_folder("Command"):
            self._add_command()
        with gui.add_folder("Time", expand_by_default=False):
            self._add_time()
        with gui.add_folder("Policy and motors"):
            self._add_machine()
        with gui.add_folder("Disturb", expand_by_default=False):
            self._add_disturbances()
        self._add_plots()

    def _add_command(self) -> None:
        gui = self.server.gui
        speed = gui.add_slider("Speed (m/s)", min=-2.0, max=TOP_SPEED, step=0.1, initial_value=0.0)
        yaw = gui.add_slider("Turn (rad/s)", min=-1.0, max=1.0, step=0.05, initial_value=0.0)
        paced = gui.add_checkbox("Self-paced", False, hint="Command within 1 m/s of the measured speed")
        self._turns(speed, "speed", float)
        self._turns(yaw, "yaw_rate", float)
        self._turns(paced, "self_paced", bool)
        keys: dict[Any, tuple[str, Callable[[], object]]] = {
            "W": ("Faster", lambda: _shift(speed, 0.5)),
            "S": ("Slower", lambda: _shift(speed, -0.5)),
            "A": ("Turn left", lambda: _shift(yaw, 0.1)),
            "D": ("Turn right", lambda: _shift(yaw, -0.1)),
            "Q": ("Straight on", lambda: _shift(yaw, -yaw.value)),
            "X": ("Stop", lambda: (_shift(speed, -speed.value), _shift(yaw, -yaw.value))),
        }
        for key, (label, action) in keys.items():
            self._add_key(key, label, action)
        buttons = gui.add_button_group("Robot", ("Stop", "Stand up"), hint=_KEYS_HINT)

        @buttons.on_click
        def _(_: Any) -> None:
            if buttons.value == "Stop":
                speed.value, yaw.value = 0.0, 0.0
            else:
                self._do(self.session.reset)

    def _add_key(self, key: Any, label: str, action: Callable[[], object]) -> None:
        """Let a key of the keyboard do something."""
        command = self.server.gui.add_command(label, hotkey=key)

        @command.on_trigger
        def _(_: Any) -> None:
            action()

    def _add_time(self) -> None:
        gui = self.server.gui
        pace = gui.add_dropdown("Pace", tuple(PACES))
        paused = gui.add_checkbox("Pause", False)

        @pace.on_update
        def _(_: Any) -> None:
            self._pace = PACES[pace.value]

        @paused.on_update
        def _(_: Any) -> None:
            self._paused = paused.value

    def _add_machine(self) -> None:
        gui, volts = self.server.gui, self.session.knobs.bus_voltage
        policy = gui.add_dropdown("Policy", self.session.policy_names)
        model = gui.add_dropdown("Motor model", MOTOR_MODELS)
        bus = gui.add_slider("Bus voltage (V)", min=10.0, max=1.5 * volts, step=1.0, initial_value=volts)
        self._turns(policy, "policy", str)
        self._turns(model, "motor_model", str)
        self._turns(bus, "bus_voltage", float)

    def _add_disturbances(self) -> None:
        gui, knobs = self.server.gui, self.session.knobs
        impulse = gui.add_slider("Push (N s)", min=5.0, max=100.0, step=5.0, initial_value=30.0)
        pushes = gui.add_button_group("Push", ("Front", "Back", "Left", "Right"))
        slope = gui.add_slider("Slope (deg)", min=-15.0, max=15.0, step=0.5, initial_value=0.0)
        friction = gui.add_slider("Friction", min=0.1, max=1.5, step=0.05, initial_value=knobs.friction)
        payload = gui.add_slider("Payload (kg)", min=-5.0, max=20.0, step=0.5, initial_value=0.0)
        self._turns(slope, "slope", math.radians)
        self._turns(friction, "friction", float)
        self._turns(payload, "payload", float)
        ways = {"Front": (-1.0, 0.0), "Back": (1.0, 0.0), "Left": (0.0, -1.0), "Right": (0.0, 1.0)}

        @pushes.on_click
        def _(_: Any) -> None:
            forward, left = (impulse.value * part for part in ways[pushes.value])
            self._do(lambda: self.session.push(forward, left))

    def _turns(self, handle: Any, knob: str, convert: Callable[[Any], Any]) -> None:
        """Let a control of the page turn one knob."""

        @handle.on_update
        def _(_: Any) -> None:
            self._do(lambda: self.session.turn(**{knob: convert(handle.value)}))

    def _do(self, action: Callable[[], object]) -> None:
        self._actions.put(action)

    def _add_plots(self) -> None:
        gui, empty = self.server.gui, np.zeros(2)
        with gui.add_folder("Speed and command (m/s)"):
            curves = _series(("speed", "#228be6"), ("command", "#e8590c"))
            self._speed_plot = gui.add_uplot((empty, empty, empty), curves, scales=_SCALES, height=150)
        with gui.add_folder("Motors on their envelopes (motor side)"):
            self._envelopes = gui.add_html("")
        with gui.add_folder("Bus power (kW)"):
            curves = _series(("power", "#12b886"))
            self._power_plot = gui.add_uplot((empty, empty), curves, scales=_SCALES, height=150)


def _shift(slider: Any, change: float) -> None:
    """Move a slider, not beyond its ends."""
    slider.value = round(min(max(slider.value + change, slider.min), slider.max), 3)


def _series(*curves: tuple[str, str]) -> Any:
    """Looks of the curves of a plot, the time first."""
    return ({"label": "s"}, *({"label": name, "stroke": color, "width": 2} for name, color in curves))


def _status_text(glimpse: Glimpse) -> str:
    """Speed, command, power and way; ``data-`` attributes for programs that read the page."""
    state = f'<span class="fell">fell: {glimpse.fall_reason}</span>' if glimpse.fall_reason else "running"
    cells = (
        (f"{glimpse.speed:.1f}", "m/s"),
        (f"{glimpse.command[0]:.1f}", "m/s asked"),
        (f"{glimpse.bus_power / 1e3:.1f}", "kW"),
        (f"{glimpse.distance:.0f}", "m"),
    )
    row = "".join(f"<td><b>{value}</b> {unit}</td>" for value, unit in cells)
    return (
        f'<div class="sprintlab" id="status" data-speed="{glimpse.speed:.3f}" data-time="{glimpse.time:.3f}" '
        f'data-distance="{glimpse.distance:.3f}" data-command="{glimpse.command[0]:.3f}" '
        f'data-falls="{glimpse.falls}"><table><tr>{row}</tr></table>{state}, {glimpse.falls} falls, '
        f"{glimpse.time:.1f} s</div>"
    )


class _RobotView:
    """The robot over a grid. The trunk stays in the middle and the ground passes below it."""

    def __init__(self, server: viser.ViserServer, session: Session) -> None:
        scene = server.scene
        self._data = session.plant.data
        self._world = scene.add_frame("/world", show_axes=False)
        self._trunk = session.plant.model.body("trunk").id
        self._grid = scene.add_grid(
            "/world/ground",
            width=60.0,
            height=60.0,
            cell_size=1.0,
            section_size=_GRID_SECTION,
            fade_distance=40.0,
            plane_color=(188, 196, 205),
            plane_opacity=0.9,
        )
        self._frames = {}
        dressed = build_model(session.robot, ModelOptions(visuals=True))
        for number, surface in enumerate(robot_surfaces(dressed)):
            body = session.plant.model.body(surface.body).id
            path = f"/world/robot/{surface.body}"
            if body not in self._frames:
                self._frames[body] = scene.add_frame(path, show_axes=False)
            red, green, blue = (round(255 * part) for part in surface.color)
            scene.add_mesh_simple(
                f"{path}/{number}",
                surface.vertices.astype(np.float32),
                surface.faces.astype(np.uint32),
                color=(red, green, blue),
            )
        server.initial_camera.position = (-1.6, -2.4, 0.9)
        server.initial_camera.look_at = (0.1, 0.0, 0.35)
        self._slope = 0.0

    def show(self, slope: float) -> None:
        """Move everything to where it is now."""
        position, quaternion = self._data.xpos, self._data.xquat
        centre = np.array([*position[self._trunk, :2], 0.0])
        for body, frame in self._frames.items():
            frame.position = position[body] - centre
            frame.wxyz = quaternion[body]
        x, y = np.mod(centre[:2], _GRID_SECTION)
        self._grid.position = (-x, -y, 0.0)
        if slope != self._slope:
            self._slope = slope
            self._world.wxyz = (math.cos(0.5 * slope), 0.0, -math.sin(0.5 * slope), 0.0)
