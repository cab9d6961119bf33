"""The errors of the platform. Most of them are also the matching built-in exception.

    SkirosError
    ├── UnknownName         also KeyError      an unknown name, id, key or code
    ├── WrongType           also TypeError     a value of another type than declared
    ├── WrongValue          also ValueError    an unusable value of the right type
    ├── Refused             also RuntimeError  a request that the current state does not allow
    │   └── Conflict                           a request based on an outdated revision
    ├── TimedOut            also TimeoutError  no response before the timeout
    ├── ConfigurationError  also ValueError    a mistake in parameters or files that a restart cannot fix
    │   └── MissingPackage  also ImportError   a missing Python package, or one that cannot be imported
    ├── WmException                            an error response of the world model (skiros2_world_model)
    │   └── WmConflict                         a conflict reported by the world model
    └── BagError                               an unreadable recorded run (skiros2_bags)

Each error text names the request, the object concerned and the expectation.
"""


class SkirosError(Exception):
    """Base of all errors that the platform raises on purpose. `str(error)` is plain text for a user."""

    def __str__(self) -> str:
        # `KeyError.__str__` would return the repr of its argument.
        return " ".join(str(a) for a in self.args)


class UnknownName(SkirosError, KeyError):
    """An unknown name, id, key or code."""


class WrongType(SkirosError, TypeError):
    """A value of another type than declared."""


class WrongValue(SkirosError, ValueError):
    """An unusable value of the right type."""


class Refused(SkirosError, RuntimeError):
    """A request that the current state does not allow."""


class Conflict(Refused):
    """A request based on data that has changed since it was read. The text begins with `MARK`."""

    #: Identifies the error where only its text is transmitted.
    MARK = "conflict: "

    def __str__(self) -> str:
        return self.MARK + super().__str__()


class TimedOut(SkirosError, TimeoutError):
    """No response before the timeout."""


class ConfigurationError(SkirosError, ValueError):
    """A mistake in launch parameters, files or names that a restart cannot fix."""


class MissingPackage(ConfigurationError, ImportError):
    """A missing Python package, or one that cannot be imported."""


#: The exceptions of library code that callers catch; `SystemExit` because library code may call `sys.exit()`.
FOREIGN_ERRORS = (Exception, SystemExit)
