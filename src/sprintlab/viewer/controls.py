"""What can be turned and pressed on the live page.

The browser's callbacks only hand actions to ``do``, which runs them between two frames, so that the
simulation is touched by one thread.
"""

from __future__ import annotations

import html
import math
from collections.abc import Callable
from typing import Any

import viser

from sprintlab.motors import MOTOR_MODELS
from sprintlab.viewer.gamepad import Gamepad, PadReading
from sprintlab.viewer.live import Session

PACES = {"real time": 1.0, "1/2": 0.5, "1/4": 0.25, "1/10": 0.1, "1/25": 0.04}
TOP_SPEED = 14.0

_KEYS_HINT = "Keys: I faster, K slower, J left, L right, U straight on, X stop, F find the robot"
# Where a push comes from, and the direction forward and left that it gives.
_PUSHES = {"Front": (-1.0, 0.0), "Back": (1.0, 0.0), "Left": (0.0, -1.0), "Right": (0.0, 1.0)}
_PAD_HELP = (
    "left stick speed, right stick turn, A and B push from the left and from the right, X stop, Y stand up"
)


class Controls:
    """The main panel, docked at the right edge.

    Attributes:
        pace: simulated seconds a second; 0 while paused.

    Args:
        server: the page.
        session: what the knobs turn.
        do: runs an action between two frames.
        darken: makes the page dark or light.
        find: puts the camera back to the robot.
    """

    def __init__(
        self,
        server: viser.ViserServer,
        session: Session,
        do: Callable[[Callable[[], object]], None],
        darken: Callable[[bool], None],
        find: Callable[[], None],
    ) -> None:
        self._gui, self._session, self._do = server.gui, session, do
        self._darken, self._find = darken, find
        gui = server.gui
        with gui.add_folder("Command"):
            self._add_command()
        with gui.add_folder("Time and light"):
            self._add_time()
        with gui.add_folder("Policy and motors"):
            self._add_machine()
        with gui.add_folder("Disturb"):
            self._add_disturbances()
        gui.main_panel.dock_right()

    @property
    def pace(self) -> float:
        """Simulated seconds a second; 0 while paused."""
        return 0.0 if self._paused.value else PACES.get(self._pace.value, 0.0)

    def follow(self, reading: PadReading) -> None:
        """Let a gamepad move the sliders and press the buttons."""
        if reading.sticks is not None:
            speed, turn = reading.sticks
            reach = self._speed.max if speed > 0.0 else -self._speed.min
            _move(self._speed, reach * speed)
            _move(self._turn, self._turn.max * turn)
        actions: dict[str, Callable[[], object]] = {
            "push-left": lambda: self._push("Right"),
            "push-right": lambda: self._push("Left"),
            "stop": self._stop,
            "stand-up": lambda: self._do(self._session.reset),
        }
        for name in reading.actions:
            actions[name]()

    def show_pad(self, pad: Gamepad) -> None:
        """Say whether the gamepad is there, and what its sticks and buttons do."""
        state, text = ("connected", _PAD_HELP) if pad.connected else ("unplugged", "plug it in to go on")
        words = f"{html.escape(pad.name)} {state}: {text}"
        self._pad.content = f'<div class="sprintlab" id="gamepad" data-state="{state}">{words}</div>'
        self._pad.visible = True

    # --- panels --------------------------------------------------------------------------------------------

    def _add_command(self) -> None:
        gui = self._gui
        self._speed = gui.add_slider("Speed (m/s)", min=-2.0, max=TOP_SPEED, step=0.1, initial_value=0.0)
        self._turn = gui.add_slider("Turn (rad/s)", min=-1.0, max=1.0, step=0.05, initial_value=0.0)
        paced = gui.add_checkbox(
            "Self-paced", False, hint="Command at most 1 m/s ahead of the measured speed"
        )
        self._turns(self._speed, "speed", float)
        self._turns(self._turn, "yaw_rate", float)
        self._turns(paced, "self_paced", bool)
        self._add_keys()
        buttons = gui.add_button_group("Robot", ("Stop", "Stand up", "Find"), hint=_KEYS_HINT)

        @buttons.on_click
        def _(_: Any) -> None:
            actions: dict[str, Callable[[], object]] = {
                "Stop": self._stop,
                "Stand up": lambda: self._do(self._session.reset),
                "Find": self._find,
            }
            actions[buttons.value]()

        self._pad = gui.add_html("", visible=False)

    def _add_keys(self) -> None:
        """Let keys of the keyboard move the sliders; viser's camera has W, A, S, D, Q, E and the arrows."""
        speed, turn = self._speed, self._turn
        keys: dict[Any, tuple[str, Callable[[], object]]] = {
            "I": ("Faster", lambda: _move(speed, speed.value + 0.5)),
            "K": ("Slower", lambda: _move(speed, speed.value - 0.5)),
            "J": ("Turn left", lambda: _move(turn, turn.value + 0.1)),
            "L": ("Turn right", lambda: _move(turn, turn.value - 0.1)),
            "U": ("Straight on", lambda: _move(turn, 0.0)),
            "X": ("Stop", self._stop),
            "F": ("Find the robot", self._find),
        }
        for key, (label, action) in keys.items():
            self._add_key(key, label, action)

    def _add_key(self, key: Any, label: str, action: Callable[[], object]) -> None:
        command = self._gui.add_command(label, hotkey=key)

        @command.on_trigger
        def _(_: Any) -> None:
            action()

    def _add_time(self) -> None:
        gui = self._gui
        self._pace = gui.add_dropdown("Pace", tuple(PACES))
        self._paused = gui.add_checkbox("Pause", False)
        dark = gui.add_checkbox("Dark page", False)

        @dark.on_update
        def _(_: Any) -> None:
            self._darken(dark.value)

    def _add_machine(self) -> None:
        gui, volts = self._gui, self._session.knobs.bus_voltage
        policy = gui.add_dropdown("Policy", self._session.policy_names)
        model = gui.add_dropdown("Motor model", MOTOR_MODELS)
        bus = gui.add_slider("Bus voltage (V)", min=10.0, max=1.5 * volts, step=1.0, initial_value=volts)
        self._turns(policy, "policy", str)
        self._turns(model, "motor_model", str)
        self._turns(bus, "bus_voltage", float)

    def _add_disturbances(self) -> None:
        gui, knobs = self._gui, self._session.knobs
        self._impulse = gui.add_slider("Push (N s)", min=5.0, max=100.0, step=5.0, initial_value=30.0)
        pushes = gui.add_button_group("Push from", tuple(_PUSHES))
        slope = gui.add_slider("Slope (deg)", min=-15.0, max=15.0, step=0.5, initial_value=0.0)
        friction = gui.add_slider("Friction", min=0.1, max=1.5, step=0.05, initial_value=knobs.friction)
        payload = gui.add_slider("Payload (kg)", min=-5.0, max=20.0, step=0.5, initial_value=0.0)
        self._turns(slope, "slope", math.radians)
        self._turns(friction, "friction", float)
        self._turns(payload, "payload", float)

        @pushes.on_click
        def _(_: Any) -> None:
            self._push(pushes.value)

    # --- actions -------------------------------------------------------------------------------------------

    def _turns(self, handle: Any, knob: str, convert: Callable[[Any], Any]) -> None:
        """Let a control of the page turn one knob."""

        @handle.on_update
        def _(_: Any) -> None:
            self._do(lambda: self._session.turn(**{knob: convert(handle.value)}))

    def _push(self, side: str) -> None:
        direction, impulse = _PUSHES.get(side, (0.0, 0.0)), self._impulse.value
        if not self._impulse.min <= impulse <= self._impulse.max:
            return
        forward, left = (impulse * part for part in direction)
        self._do(lambda: self._session.push(forward, left))

    def _stop(self) -> None:
        _move(self._speed, 0.0)
        _move(self._turn, 0.0)


def _move(slider: Any, value: float) -> None:
    """Put a slider at the step nearest to a value, not beyond its ends; NaN counts as its least value."""
    within = min(max(slider.min, value), slider.max)
    stepped = slider.step * round(within / slider.step)
    slider.value = round(min(max(stepped, slider.min), slider.max), 3) + 0.0
