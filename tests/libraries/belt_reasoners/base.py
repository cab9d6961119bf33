from skiros2_common.core.discrete_reasoner import DiscreteReasoner


class QuietReasoner(DiscreteReasoner):
    """What the reasoners of this package have in common: no data, no relations."""

    def parse(self, element, action):
        return True

    def run(self):
        pass

    def getAssociatedRelations(self):
        return []

    def getAssociatedProperties(self):
        return []

    def getAssociatedData(self):
        return []

    def onAddProperties(self, element):
        pass

    def onRemoveProperties(self, element):
        pass
