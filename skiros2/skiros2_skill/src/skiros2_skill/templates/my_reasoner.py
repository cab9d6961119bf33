"""The reasoner MyReasoner: owns the weight of the elements that name it in skiros:DiscreteReasoner."""

from skiros2_common.core.discrete_reasoner import DiscreteReasoner

WEIGHT, HEAVIER = "skiros:Weight", "my_skills:heavierThan"


class MyReasoner(DiscreteReasoner):
    """Compares weights."""

    def parse(self, element, action):
        """Called before an element is added, updated or removed. Return False to refuse the change."""
        return True

    def run(self):
        """Called in a thread after each load of a scene; may loop until `self.stopRequested`."""

    def getAssociatedProperties(self):
        """The codes of `getData` and `setData`."""
        return [":Weight"]

    def getAssociatedData(self):
        """The properties that the reasoner owns."""
        return [WEIGHT]

    def getAssociatedRelations(self):
        """The relations that it computes."""
        return [HEAVIER]

    def onAddProperties(self, element):
        if not element.hasProperty(WEIGHT):
            element.setProperty(WEIGHT, 0.0)

    def onRemoveProperties(self, element):
        element.removeProperty(WEIGHT)

    def hasData(self, element, get_code):
        return element.hasProperty(WEIGHT)

    def getData(self, element, get_code):
        return element.getProperty(WEIGHT).value

    def setData(self, element, data, set_code):
        element.setProperty(WEIGHT, float(data))

    def computeRelations(self, sub, obj, with_metrics=False):
        """The relations from `sub` to `obj`; with `with_metrics`, pairs of relation and distance."""
        difference = sub.getProperty(WEIGHT).value - obj.getProperty(WEIGHT).value
        found = [HEAVIER] if difference > 0.0 else []
        return [(relation, difference) for relation in found] if with_metrics else found
