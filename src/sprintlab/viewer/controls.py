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

    ``do`` runs an action between two frames, ``find`` puts the camera back to the robot.
    """

    def __init__(
        self,
        server: viser.ViserServer,
        session: Session,
        do: Callable[[Callable[[], object]], None],
        find: Callable[[], None],
    ) -> None:
        self._gui, self._session, self._do = server.gui, session, do
        self._actions: dict[str, Callable[[], None]] = {
            "Stop": self._stop,
            "Stand up": lambda: do(session.reset),
            "Find": find,
            **{side: lambda side=side: self._push(side) for side in _PUSHES},
        }
        gui, volts = server.gui, session.knobs.bus_voltage
        with gui.add_folder("Command"):
            self._speed = self._slider("speed", "Speed (m/s)", (-2.0, TOP_SPEED, 0.1), 0.0)
            self._turn = self._slider("yaw_rate", "Turn (rad/s)", (-1.0, 1.0, 0.05), 0.0)
            hint = "Command at most 1 m/s ahead of the measured speed"
            self._turns(gui.add_checkbox("Self-paced", False, hint=hint), "self_paced", bool)
            self._add_keys()
            self._buttons("Robot", ("Stop", "Stand up", "Find"), _KEYS_HINT)
            self._pad = gui.add_html("", visible=False)
        with gui.add_folder("Time"):
            self._pace = gui.add_dropdown("Pace", tuple(PACES))
            self._paused = gui.add_checkbox("Pause", False)
        with gui.add_folder("Policy and motors"):
            self._turns(gui.add_dropdown("Policy", session.policy_names), "policy", str)
            self._turns(gui.add_dropdown("Motor model", MOTOR_MODELS), "motor_model", str)
            self._slider("bus_voltage", "Bus voltage (V)", (10.0, 1.5 * volts, 1.0), volts)
        with gui.add_folder("Disturb"):
            self._impulse = gui.add_slider("Push (N s)", min=5.0, max=100.0, step=5.0, initial_value=30.0)
            self._buttons("Push from", tuple(_PUSHES))
            self._slider("slope", "Slope (deg)", (-15.0, 15.0, 0.5), 0.0, math.radians)
            self._slider("friction", "Friction", (0.1, 1.5, 0.05), session.knobs.friction)
            self._slider("payload", "Payload (kg)", (-5.0, 20.0, 0.5), 0.0)
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
        names = {"push-left": "Right", "push-right": "Left", "stop": "Stop", "stand-up": "Stand up"}
        for name in reading.actions:
            self._actions[names[name]]()

    def show_pad(self, pad: Gamepad) -> None:
        """Say whether the gamepad is there, and what its sticks and buttons do."""
        state, text = (
            ("connected", _PAD_HELP) if pad.connected else ("unplugged", "start again to drive with it")
        )
        words = f"{html.escape(pad.name)} {state}: {text}"
        self._pad.content = f'<div class="sprintlab" id="gamepad" data-state="{state}">{words}</div>'
        self._pad.visible = True

    def _slider(
        self,
        knob: str,
        label: str,
        span: tuple[float, float, float],
        value: float,
        convert: Callable[[Any], Any] = float,
    ) -> Any:
        """A slider with least and greatest value and step that turns one knob."""
        low, high, step = span
        slider = self._gui.add_slider(label, min=low, max=high, step=step, initial_value=value)
        self._turns(slider, knob, convert)
        return slider

    def _turns(self, handle: Any, knob: str, convert: Callable[[Any], Any]) -> None:
        """Let a control of the page turn one knob."""
        handle.on_update(lambda _: self._do(lambda: self._session.turn(**{knob: convert(handle.value)})))

    def _buttons(self, label: str, names: tuple[str, ...], hint: str | None = None) -> None:
        buttons = self._gui.add_button_group(label, names, hint=hint)
        buttons.on_click(lambda _: self._actions[buttons.value]())

    def _add_keys(self) -> None:
        """Let keys of the keyboard move the sliders; viser's camera has W, A, S, D, Q, E and the arrows."""
        speed, turn = self._speed, self._turn
        keys: dict[Any, tuple[str, Callable[[], None]]] = {
            "I": ("Faster", lambda: _move(speed, speed.value + 0.5)),
            "K": ("Slower", lambda: _move(speed, speed.value - 0.5)),
            "J": ("Turn left", lambda: _move(turn, turn.value + 0.1)),
            "L": ("Turn right", lambda: _move(turn, turn.value - 0.1)),
            "U": ("Straight on", lambda: _move(turn, 0.0)),
            "X": ("Stop", self._stop),
            "F": ("Find the robot", self._actions["Find"]),
        }
        for key, (label, action) in keys.items():
            self._gui.add_command(label, hotkey=key).on_trigger(lambda _, action=action: action())

    def _push(self, side: str) -> None:
        forward, left = (self._impulse.value * part for part in _PUSHES[side])
        self._do(lambda: self._session.push(forward, left))

    def _stop(self) -> None:
        _move(self._speed, 0.0)
        _move(self._turn, 0.0)


def _move(slider: Any, value: float) -> None:
    """Put a slider at the step nearest to a value, not beyond its ends; NaN counts as its least value."""
    within = min(max(slider.min, value), slider.max)
    stepped = slider.step * round(within / slider.step)
    slider.value = round(min(max(stepped, slider.min), slider.max), 3) + 0.0
