"""The return status of the methods of ISA-95 Job Control."""

from __future__ import annotations

from enum import IntFlag


class ReturnStatus(IntFlag):
    """The bits of `ReturnStatus` (UInt64) in OPC 10031-4 that the gateway sets; exactly one in each answer."""

    SUCCESS = 1 << 0
    UNKNOWN_JOB = 1 << 1
    INVALID_STATE = 1 << 3
    NOT_ACCEPTED = 1 << 4
