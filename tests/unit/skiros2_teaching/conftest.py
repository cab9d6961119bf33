"""A scene with a block, in a world model with a journal."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path

import pytest

from skiros2_common.core.world_element import Element
from skiros2_motion.core.geometry import Pose, from_euler
from skiros2_std_reasoners.core import spatial_data as space
from skiros2_world_model.core.journal import Journal
from skiros2_world_model.core.local_world_model import LocalWorldModel, source_ontologies
from skiros2_world_model.core.world_model import WorldModel

#: Of the block, in the scene.
BLOCK_POSE = Pose((0.5, 0.1, 0.4), from_euler(0.0, 0.0, math.radians(30.0)))


@pytest.fixture
def wmi(tmp_path: Path) -> Iterator[LocalWorldModel]:
    journal = Journal(tmp_path / "wm.journal")
    yield LocalWorldModel("teacher", WorldModel(source_ontologies(), tmp_path, journal=journal))
    journal.close()


@pytest.fixture
def block(wmi: LocalWorldModel) -> Element:
    element = Element("skiros:Part", "block")
    space.set_pose(element, BLOCK_POSE)
    element.addRelation("skiros:Scene-0", "skiros:contain", "-1")
    return wmi.add_element(element)
