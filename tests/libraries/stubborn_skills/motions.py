"""Motions that block, brake or never return."""

import threading
import time

from skiros2_common.core.abstract_skill import SkillDescription, State
from skiros2_common.core.params import ParamTypes
from skiros2_common.core.primitive import PrimitiveBase
from skiros2_common.core.world_element import Element

_NEVER = threading.Event()


class Block(SkillDescription):
    def createDescription(self):
        self.addParam("Seconds", 0.0, ParamTypes.Optional)
        self.addParam("Thing", Element("skiros:Product"), ParamTypes.Optional)


class block(PrimitiveBase):
    """Blocks in `execute`, and succeeds."""

    def createDescription(self):
        self.setDescription(Block(), "block")

    def execute(self):
        time.sleep(self.params["Seconds"].value)
        return self.success("done")


class hang(PrimitiveBase):
    """Does not return from `execute`."""

    def createDescription(self):
        self.setDescription(Block(), "hang")

    def execute(self):
        _NEVER.wait()


class brake(PrimitiveBase):
    """Takes its time after the preemption, and succeeds then."""

    def createDescription(self):
        self.setDescription(Block(), "brake")

    def onStart(self):
        self.stops_at = None
        return True

    def onPreempt(self):
        self.stops_at = time.monotonic() + self.params["Seconds"].value
        return State.Running

    def execute(self):
        if self.stops_at is not None and time.monotonic() > self.stops_at:
            return self.success("stopped softly")
        return self.step("")


class creep(PrimitiveBase):
    """Goes on until it is preempted."""

    def createDescription(self):
        self.setDescription(Block(), "creep")

    def execute(self):
        return self.step("")


class raises_in_constructor(PrimitiveBase):
    def __init__(self):
        super().__init__()
        raise RuntimeError("no license")

    def createDescription(self):
        self.setDescription(Block(), "raises_in_constructor")


class raises_in_init(PrimitiveBase):
    def createDescription(self):
        self.setDescription(Block(), "raises_in_init")

    def onInit(self):
        raise RuntimeError("no camera")


class declines(PrimitiveBase):
    def createDescription(self):
        self.setDescription(Block(), "declines")

    def onInit(self):
        return False
