"""A scene with a robot, two trays and two products, and a way to run skills on it in this process."""

import sys

import pytest

from skiros2_common.core.abstract_skill import State
from skiros2_common.core.params import ParamTypes
from skiros2_common.core.world_element import Element
from skiros2_skill.core.library import SkillLibrary
from skiros2_skill.core.task import Task
from skiros2_skill.core.ticker import RECURSION_LIMIT
from skiros2_world_model.core.local_world_model import LocalWorldModel

SCENE = "skiros:Scene-0"


class Workbench:
    """A world model, a skill library on it, and tasks ticked by hand."""

    def __init__(self, wmi):
        self.wmi = wmi
        self.library = SkillLibrary(wmi)
        self.robot = self.add("cora:Robot", "skiros:robot")
        self.tray = self.add("skiros:LargeBox", "tray")
        self.other_tray = self.add("skiros:LargeBox", "other tray")
        self.product = self.add("skiros:Product", "product", self.tray)
        self.other_product = self.add("skiros:Product", "other product", self.other_tray)

    def add(self, etype, label, container=None, **properties):
        element = Element(etype, label)
        for key, value in properties.items():
            element.setProperty(f"skiros:{key}", value)
        element.addRelation(container.id if container else SCENE, "skiros:contain", "-1")
        self.wmi.add_element(element)
        return element

    def load(self, *classes):
        for cls in classes:
            self.library.add(cls)
        return self

    def node(self, name, remap=None, **specify):
        """A node for the skill with that label."""
        from skiros2_skill.core.skill import SkillWrapper

        node = SkillWrapper(self.library.by_label(name).type, name, self.library)
        for child_key, key in (remap or {}).items():
            node.remap(child_key, key)
        for key, values in specify.items():
            node.specifyParam(key, values)
        return node

    def task(self, *nodes, **blackboard):
        task = Task(0, self.wmi, "test")
        task.root.params.addParam("Robot", self.robot, ParamTypes.Inferred)
        for key, value in blackboard.items():
            task.root.params.addParam(key, value, ParamTypes.Optional)
        task.root(*nodes)
        return task

    def run(self, *nodes, ticks=50, **blackboard):
        """Ticks a task of these nodes until it ends."""
        task = self.task(*nodes, **blackboard)
        for _ in range(ticks):
            if task.tick() is not State.Running:
                break
        return task


@pytest.fixture
def bench():
    return Workbench(LocalWorldModel("test"))


@pytest.fixture
def deep_stack():
    """As many frames as a ticker allows for."""
    limit = sys.getrecursionlimit()
    sys.setrecursionlimit(RECURSION_LIMIT)
    yield
    sys.setrecursionlimit(limit)
