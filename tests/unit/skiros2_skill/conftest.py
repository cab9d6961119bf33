"""A scene with a robot, two trays and two products, and a way to run skills on it in this process."""

import sys

import pytest

from skiros2_skill.core.runtime.scheduler import RECURSION_LIMIT
from skiros2_skill.testing import SkillBench


class Workbench(SkillBench):
    """The bench with this scene."""

    def __init__(self, wmi=None):
        super().__init__(wmi=wmi)
        self.tray = self.add("skiros:LargeBox", "tray")
        self.other_tray = self.add("skiros:LargeBox", "other tray")
        self.product = self.add("skiros:Product", "product", self.tray)
        self.other_product = self.add("skiros:Product", "other product", self.other_tray)


@pytest.fixture
def bench():
    with Workbench() as bench:
        yield bench


@pytest.fixture
def deep_stack():
    """As many frames as a scheduler allows for."""
    limit = sys.getrecursionlimit()
    sys.setrecursionlimit(RECURSION_LIMIT)
    yield
    sys.setrecursionlimit(limit)
