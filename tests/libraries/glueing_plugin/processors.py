"""A processor."""

from skiros2_common.core.abstract_skill import State
from skiros2_skill.core.processors import Processor


class LastFirst(Processor):
    """Ticks the children in reverse order, until one does not succeed."""

    symbol = "<-"

    def processChildren(self, children, visitor):
        for child in reversed(children):
            state = child.visit(visitor)
            if state is not State.Success:
                return state
        return State.Success
