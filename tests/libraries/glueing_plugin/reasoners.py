"""A reasoner."""

from skiros2_common.core.discrete_reasoner import DiscreteReasoner


class DryingReasoner(DiscreteReasoner):
    """Newly added parts are wet."""

    def parse(self, element, action):
        if action == "add" and element.type == "skiros:Part":
            element.setProperty("glue:Wet", True)
        return True

    def getAssociatedProperties(self):
        return ["glue:Wet"]
