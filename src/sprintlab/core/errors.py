"""The errors a user can meet. Each message is one sentence that names what is wrong.

The same everywhere: a field or argument with an impossible value raises ``InvalidValueError``, a file that is
missing, damaged or of another form the ``SprintlabError`` of its kind, and one that cannot be written
``UnwrittenError``. Docstrings say what does not follow from this.
"""

_LONGEST_VALUE = 300  # characters of a refused value in a message
_LONGEST = 2000  # characters of a message


def printable(text: object, longest: int = _LONGEST_VALUE) -> str:
    """Text for a message: control characters as their codes, e.g. ``\\x1b``, and cut where it is long."""
    plain = "".join(
        sign if sign.isprintable() else sign.encode("unicode_escape").decode()
        for sign in str(text)[: longest + 1]
    )
    return plain if len(plain) <= longest else plain[:longest] + "..."


class SprintlabError(Exception):
    """Base of every error this package raises on purpose. Its text is one line."""

    def __str__(self) -> str:
        return printable(" ".join(super().__str__().split()), _LONGEST)


class InvalidValueError(SprintlabError, ValueError):
    """A field holds a value that is not allowed.

    Args:
        field: name of the field as the user wrote it, e.g. ``motor.stator_resistance``.
        value: the refused value.
        allowed: what would have been accepted, in words with units.
    """

    def __init__(self, field: str, value: object, allowed: str) -> None:
        written = " ".join(repr(value).split())  # arrays are written over several lines
        if len(written) > _LONGEST_VALUE:
            written = f"{written[:_LONGEST_VALUE]}..."
        super().__init__(f"{field} = {written} is not allowed: {allowed}")
        self.field = field
        self.value = value
        self.allowed = allowed

    def __reduce__(self) -> tuple[type, tuple[object, ...]]:
        """Survive pickling, which worker processes need to report it."""
        return type(self), (self.field, self.value, self.allowed)


class MissingValueError(InvalidValueError):
    """A field has no value where it needs one; ``allowed`` says what to give."""

    def __init__(self, field: str, allowed: str) -> None:
        super().__init__(field, None, allowed)
        self.args = (f"{field} is missing: {allowed}",)

    def __reduce__(self) -> tuple[type, tuple[object, ...]]:
        """As for every invalid value."""
        return type(self), (self.field, self.allowed)


class UnwrittenError(SprintlabError):
    """A file or a folder cannot be written."""

    # the result that was to be written, complete and still usable; ``None`` if the error came before there
    # was one
    found: object = None


class PolicyFileError(SprintlabError):
    """A policy file is missing, truncated, or not one of ours."""


class ContractMismatchError(SprintlabError):
    """A policy's contract does not match the robot it is asked to drive."""


class RobotModelError(SprintlabError):
    """A robot's files do not describe a robot that can be built."""


class SimulationError(SprintlabError):
    """A simulation left the realm of finite numbers."""
