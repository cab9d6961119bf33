"""Whether a failed skill may be tried again."""

from __future__ import annotations

from enum import StrEnum


class FailureKind(StrEnum):
    """The kinds of failures, the least severe first. All but `RETRYABLE` are *final*: nothing retries them, neither a
    processor nor a new plan. A person decides how the work continues."""

    RETRYABLE = "retryable"
    #: A part is not where the robot has left it, and nothing measures where it is.
    LOST = "lost"
    #: A limit has stopped the robot, such as that of a force.
    LIMIT = "limit"
    #: A measured value is missing, invalid or frozen.
    SENSOR = "sensor"
    #: Somebody else has switched off or taken the controller that the skill uses.
    CONTROLLER = "controller"
    #: An emergency stop, a protective stop or a fault of the robot.
    SAFETY = "safety"

    @property
    def is_final(self) -> bool:
        """Whether the failure must not be retried."""
        return self is not FailureKind.RETRYABLE

    @property
    def allows_reaction(self) -> bool:
        """Whether a reaction such as a retreat may follow: the robot still has its controller and its sensors."""
        return self in (FailureKind.RETRYABLE, FailureKind.LOST, FailureKind.LIMIT)

    @property
    def severity(self) -> int:
        """0 for `RETRYABLE`; greater for more severe kinds."""
        return list(FailureKind).index(self)

    @property
    def words(self) -> str:
        """Why it is not retried, for people; "" for `RETRYABLE`."""
        return _WORDS.get(self, "")

    def worst(self, other: FailureKind) -> FailureKind:
        """Returns the more severe one."""
        return other if other.severity > self.severity else self

    @classmethod
    def read(cls, text: str) -> FailureKind:
        """Returns the kind with a value. An unknown one, of another version, is final."""
        return next((kind for kind in cls if kind.value == text), cls.SAFETY)


_WORDS = {
    FailureKind.LOST: "a part was lost",
    FailureKind.LIMIT: "a limit was exceeded",
    FailureKind.SENSOR: "a sensor cannot be trusted",
    FailureKind.CONTROLLER: "the controller was switched off by somebody else",
    FailureKind.SAFETY: "the robot was stopped",
}
