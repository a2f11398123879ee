"""The errors a user can meet. Each message is one sentence that names what is wrong."""

import contextlib
import io
import sys
from collections.abc import Generator

_LONGEST_VALUE = 300  # characters of a refused value in a message
_LONGEST = 2000  # characters of a message


def printable(text: object, longest: int = _LONGEST_VALUE) -> str:
    """Text of a stranger as it may stand on a terminal: no control characters, no turned writing, not long.

    What a terminal would obey instead of show (escape sequences, carriage returns, writing from right to
    left) appears as its code, e.g. ``\\x1b``.
    """
    plain = "".join(
        sign if sign.isprintable() else sign.encode("unicode_escape").decode()
        for sign in str(text)[: longest + 1]
    )
    return plain if len(plain) <= longest else plain[:longest] + "..."


def printable_lines(text: str) -> str:
    """Text of several lines, each as ``printable``, whatever its length."""
    longest_code = len("\\U00000000")
    return "\n".join(printable(line, longest_code * len(line)) for line in text.split("\n"))


@contextlib.contextmanager
def printable_stderr() -> Generator[None]:
    """Shows what a parser says of its arguments as ``printable_lines``: names of files may be among them."""
    said = io.StringIO()
    try:
        with contextlib.redirect_stderr(said):
            yield
    finally:
        print(printable_lines(said.getvalue()), end="", file=sys.stderr)


class SprintlabError(Exception):
    """Base of every error this package raises on purpose. Its text is one line, ``printable``."""

    def __str__(self) -> str:
        return printable(" ".join(super().__str__().split()), _LONGEST)


def _written(value: object) -> str:
    """A refused value as Python writes it; some it refuses itself: lists in lists, numbers of 5000 digits."""
    try:
        return repr(value)
    except (RecursionError, ValueError):
        return f"<{type(value).__name__}>"


class InvalidValueError(SprintlabError, ValueError):
    """A field holds a value that is not allowed.

    Args:
        field: name of the field as the user wrote it, e.g. ``motor.stator_resistance``.
        value: the refused value.
        allowed: what would have been accepted, in words with units.
    """

    def __init__(self, field: str, value: object, allowed: str) -> None:
        written = " ".join(_written(value).split())  # arrays are written over several lines
        if len(written) > _LONGEST_VALUE:
            written = f"{written[:_LONGEST_VALUE]}..."
        super().__init__(f"{field} = {written} is not allowed: {allowed}")
        self.field = field
        self.value = value
        self.allowed = allowed

    def __reduce__(self) -> tuple[type, tuple[str, object, str]]:
        """Survive pickling, which worker processes need to report it."""
        return type(self), (self.field, self.value, self.allowed)


class UnwrittenError(SprintlabError):
    """A file or a folder cannot be written.

    Attributes:
        found: the result that was to be written, complete and still usable; ``None`` if the error came before
            there was one.
    """

    found: object = None


class PolicyFileError(SprintlabError):
    """A policy file is missing, truncated, or not one of ours."""


class ContractMismatchError(SprintlabError):
    """A policy's contract does not match the robot it is asked to drive."""


class RobotModelError(SprintlabError):
    """A robot's files do not describe a robot that can be built."""


class SimulationError(SprintlabError):
    """A simulation left the realm of finite numbers."""
