"""Reasoners that go wrong, each in its own way."""

from belt_reasoners.base import QuietReasoner


class FaultyConstructor(QuietReasoner):
    def __init__(self):
        raise ValueError("no constructor")


class FaultyInit(QuietReasoner):
    def init(self, wmi):
        raise ValueError("no init")


class FaultyRun(QuietReasoner):
    def run(self):
        raise ValueError("no run")


class FaultyAddProperties(QuietReasoner):
    def onAddProperties(self, element):
        raise ValueError("no properties")
