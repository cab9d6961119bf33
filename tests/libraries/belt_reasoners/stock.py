"""Counts what lies in containers, and keeps overfull ones out of the scene."""

import time
from threading import Lock

import skiros2_common.tools.logger as log
from belt_reasoners.base import QuietReasoner
from skiros2_common.core.world_element import Element


class StockReasoner(QuietReasoner):
    def __init__(self):
        self._mutex = Lock()
        self._containers = {}
        self._seen = []
        self._rounds = 0

    def parse(self, element, action):
        if element.type == "skiros:Part" and element.label == "explosive":
            raise RuntimeError("what is this?")
        if element.label == "forbidden" and action == "add":
            return False
        if element.type == "skiros:Part" and action == "add" and not element.hasProperty("skiros:Weight"):
            element.setProperty("skiros:Weight", 0.25)
        if element.hasProperty("skiros:DiscreteReasoner", self.__class__.__name__):
            with self._mutex:
                if action == "remove":
                    self._containers.pop(element.id, None)
                else:
                    self._containers[element.id] = element
        if element.label != "log book":
            self._seen.append(action + " " + element.label)
        return True

    def run(self):
        self._rounds += 1
        with self._mutex:
            self._containers = {}
            for e in self._wmi.resolve_elements(Element("skiros:LargeBox")):
                if e.hasProperty("skiros:DiscreteReasoner", self.__class__.__name__):
                    self._containers[e.id] = e
        log.info("[StockReasoner]", str(len(self._containers)) + " containers")
        while not self.stopRequested:
            with self._mutex:
                containers = list(self._containers)
            for eid in containers:
                self._update(eid)
            self._note()
            time.sleep(0.02)

    def _update(self, eid):
        try:
            e = self._wmi.get_element(eid)
        except Exception:
            return  # removed meanwhile
        inside = self._wmi.get_recursive(eid, "skiros:contain", "skiros:Part")
        count = len(inside) - 1
        if not e.hasProperty("belt:Stock", count):
            e.setProperty("belt:Stock", count)
            e.label = "not to be written"
            self._wmi.update_properties(e, self.__class__.__name__, self, False)

    def _note(self):
        """A log book in the scene, for whoever reads it from outside."""
        book = Element("skiros:Location", "log book")
        found = self._wmi.resolve_elements(book)
        if found:
            book = found[0]
        else:
            book.addRelation("skiros:Scene-0", "skiros:contain", "-1")
            book = self._wmi.add_element(book, self.__class__.__name__)
        text = str(self._rounds) + ";" + ",".join(self._seen)
        if not book.hasProperty("belt:Log", text):
            book.setProperty("belt:Log", text)
            self._wmi.update_properties(book, self.__class__.__name__)

    def onAddProperties(self, element):
        if not element.hasProperty("belt:Stock"):
            element.setProperty("belt:Stock", 0)

    def onRemoveProperties(self, element):
        element.removeProperty("belt:Stock")

    def getAssociatedProperties(self):
        return [":Stock"]

    def getAssociatedData(self):
        return ["belt:Stock"]

    def getAssociatedRelations(self):
        return [":fuller"]

    def hasData(self, element, get_code):
        return element.hasProperty("belt:Stock", not_none=True)

    def getData(self, element, get_code):
        return element.getProperty("belt:Stock").value

    def setData(self, element, data, set_code):
        element.setProperty("belt:Stock", int(data))

    def computeRelations(self, sub, obj, with_metrics=False):
        difference = self.getData(sub, ":Stock") - self.getData(obj, ":Stock")
        if difference <= 0:
            return []
        return [(":fuller", difference)] if with_metrics else [":fuller"]
