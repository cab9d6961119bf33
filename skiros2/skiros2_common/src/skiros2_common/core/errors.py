"""The errors of the platform: one tree, each also the built-in that fits.

    SkirosError
    ├── UnknownName         also KeyError      a name, id, key or code that nobody knows
    ├── WrongType           also TypeError     a value of another type than declared
    ├── WrongValue          also ValueError    a value of the right type that cannot be used
    ├── Refused             also RuntimeError  a request that the present state does not allow
    │   └── Conflict                           a request on something that has been changed meanwhile
    ├── TimedOut            also TimeoutError  no answer within the time given
    ├── ConfigurationError  also ValueError    a mistake in parameters or files that no restart mends
    │   └── MissingPackage  also ImportError   a Python package that is not there, or cannot be imported
    ├── WmException                            what the world model answers (skiros2_world_model)
    │   └── WmConflict                         likewise, when it is a conflict
    └── BagError                               a recorded run that cannot be read (skiros2_bags)

The text of each names what was asked, where, and what was expected.
"""


class SkirosError(Exception):
    """Base of all errors that the platform raises on purpose. `str(error)` is plain text for a user."""

    def __str__(self) -> str:
        # KeyError would show the repr of its argument.
        return " ".join(str(a) for a in self.args)


class UnknownName(SkirosError, KeyError):
    """A name, id, key or code that nobody knows."""


class WrongType(SkirosError, TypeError):
    """A value of another type than declared."""


class WrongValue(SkirosError, ValueError):
    """A value of the right type that cannot be used."""


class Refused(SkirosError, RuntimeError):
    """A request that the present state does not allow."""


class Conflict(Refused):
    """A request that was based on something that has been changed meanwhile. The text begins with `MARK`."""

    #: How the error is known again where only its text arrives.
    MARK = "conflict: "

    def __str__(self) -> str:
        return self.MARK + super().__str__()


class TimedOut(SkirosError, TimeoutError):
    """No answer within the time given."""


class ConfigurationError(SkirosError, ValueError):
    """A mistake in launch parameters, files or names, which no restart mends."""


class MissingPackage(ConfigurationError, ImportError):
    """A Python package that is not there, or cannot be imported."""


#: What code of libraries may raise without ending the thread or the node that calls it; `sys.exit()` is an exception.
FOREIGN_ERRORS = (Exception, SystemExit)
