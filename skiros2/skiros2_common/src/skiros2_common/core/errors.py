"""The errors of the platform. Most of them are also the matching built-in exception.

    SkirosError
    ├── UnknownName         also KeyError      an unknown name, id, key or code
    ├── WrongType           also TypeError     a value of another type than declared
    ├── WrongValue          also ValueError    an unusable value of the right type
    │   └── OutOfLimits                        a parameter value that its declaration does not allow
    ├── Refused             also RuntimeError  a request that the current state does not allow
    │   ├── Conflict                           a request based on an outdated revision
    │   └── RobotStopped                       a start while the robot is stopped
    ├── TimedOut            also TimeoutError  no response before the timeout
    ├── ConfigurationError  also ValueError    a mistake in parameters or files that a restart cannot fix
    │   └── MissingPackage  also ImportError   a missing Python package, or one that cannot be imported
    ├── WmException                            an error response of the world model (skiros2_world_model)
    │   └── WmConflict                         a conflict reported by the world model
    └── BagError                               an unreadable recorded run (skiros2_bags)

Each error text names the request, the object concerned and the expectation.
"""

from typing import Self

#: The most characters of an error text: it may repeat names of a request, which have any length.
_MAX_TEXT = 100_000


class SkirosError(Exception):
    """Base of all errors that the platform raises on purpose. `str(error)` is plain text for a user."""

    #: The kind of error, also where only texts are transmitted.
    code = "error"
    #: Line and column (from 1) of a syntax error in the text that the error is about; (0, 0): unknown.
    position = (0, 0)

    def __str__(self) -> str:
        # `KeyError.__str__` would return the repr of its argument.
        text = " ".join(str(a) for a in self.args)
        return text if len(text) <= _MAX_TEXT else f"{text[:_MAX_TEXT]} ... ({len(text)} characters)"

    def with_text(self, text: str) -> Self:
        """Returns the same error with another text. Its constructor, which may take other arguments, is not called."""
        error = type(self).__new__(type(self))
        error.__dict__.update(self.__dict__)
        error.args = (text,)
        return error


class UnknownName(SkirosError, KeyError):
    """An unknown name, id, key or code."""

    code = "unknown_name"


class WrongType(SkirosError, TypeError):
    """A value of another type than declared."""

    code = "wrong_type"


class WrongValue(SkirosError, ValueError):
    """An unusable value of the right type."""

    code = "wrong_value"


class OutOfLimits(WrongValue):
    """A parameter value outside the declared limits or choices."""

    #: The progress code of a skill that does not start for this reason.
    CODE = -4


class Refused(SkirosError, RuntimeError):
    """A request that the current state does not allow."""

    code = "refused"


class Conflict(Refused):
    """A request based on data that has changed since it was read."""

    code = "conflict"


class RobotStopped(Refused):
    """A start of a skill while a stop of its robot is active."""

    code = "robot_stopped"
    #: The progress code of a task that was refused or has failed because of a stop.
    CODE = -5


class TimedOut(SkirosError, TimeoutError):
    """No response before the timeout."""

    code = "timed_out"


class ConfigurationError(SkirosError, ValueError):
    """A mistake in launch parameters, files or names that a restart cannot fix."""

    code = "configuration"


class MissingPackage(ConfigurationError, ImportError):
    """A missing Python package, or one that cannot be imported."""


#: The exceptions of library code that callers catch; `SystemExit` because library code may call `sys.exit()`.
FOREIGN_ERRORS = (Exception, SystemExit)
