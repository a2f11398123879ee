"""``sprintlab play``: drive a robot in the browser."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from sprintlab.api.live import play
from sprintlab.cli.output import print_json, stderr_console, stdout_console
from sprintlab.core.joystick import DEFAULT_DEVICE

OptionalDevice = tyro.constructors.PrimitiveConstructorSpec(
    nargs=(0, 1),
    metavar="[DEVICE]",
    instance_from_str=lambda words: Path(words[0]) if words else DEFAULT_DEVICE,
    is_instance=lambda value: value is None or isinstance(value, Path),
    str_from_instance=lambda value: [] if value is None else [str(value)],
)
"""An option whose value may be left out."""


@dataclass(frozen=True, kw_only=True)
class Play:
    """Drive a robot in the browser: speed, turns, pushes, slope, friction, payload, policy, motor model.

    Attributes:
        policies: policy files, or names of policies that come with the package; those that fit the robot
            when left out. The page switches between them.
        robot: a robot's name, or a parameter table of one's own (.toml); the first policy's when left out,
            without a policy, that of sprint.
        host: interface to listen on; 0.0.0.0 lets other machines in.
        port: first port to try.
        gamepad: drive with a gamepad too; a device other than /dev/input/js0 may follow.
        duration: stop after this time [s]; runs until Ctrl-C when left out.
        open: also open the page in a browser.
        json: print the address as JSON only.
    """

    policies: tyro.conf.Positional[tuple[str, ...]] = ()
    robot: str | None = None
    host: str = "localhost"
    port: int = 8080
    gamepad: Annotated[Path | None, OptionalDevice] = None
    duration: float | None = None
    open: bool = False
    json: bool = False

    def run(self) -> int:
        """Serve the page until Ctrl-C or the end of its time.

        Raises:
            SprintlabError: viser is missing, policy or gamepad are refused, or nothing can be served there.
        """
        page = play(
            self.policies,
            self.robot,
            host=self.host,
            port=self.port,
            gamepad=self.gamepad,
            duration=self.duration,
        )
        with suppress(KeyboardInterrupt):
            self._announce(page.address)
            page.run()
        return 0

    def _announce(self, address: str) -> None:
        if self.json:
            print_json({"address": address})
        else:
            stdout_console().print(f"open {address} in a browser; Ctrl-C ends it", soft_wrap=True)
        if self.open:
            import webbrowser

            if not webbrowser.open(address):
                stderr_console().print("no browser could be opened here", soft_wrap=True)
