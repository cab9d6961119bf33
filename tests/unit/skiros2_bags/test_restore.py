"""Restoring the scene of a world model from a bag."""

from __future__ import annotations

from pathlib import Path

import pytest

from skiros2_bags.core.restore import Restored, restore
from skiros2_bags.core.run import Run
from skiros2_common.core.world_element import Element
from skiros2_world_model.core.local_world_model import LocalWorldModel, source_ontologies
from skiros2_world_model.core.scene import Scene
from skiros2_world_model.core.wm_errors import WmException
from skiros2_world_model.core.world_model import WorldModel

BAG = Path(__file__).parents[2] / "bags/pick_place.bag"
WORKSPACE = Path(__file__).parents[3] / "skiros2_std_lib/demos/timed_skills/owl"


@pytest.fixture(scope="module")
def run() -> Run:
    return Run.open(BAG)


def content(scene: Scene) -> dict[str, object]:
    return {n.id: (n.type, n.label, {k: p.values for k, p in n.properties.items() if p.values}) for n in scene}


def world_model(workspace: Path | None, strict: bool = False) -> tuple[LocalWorldModel, WorldModel]:
    """A world model in this process, and its interface for skills."""
    model = WorldModel(source_ontologies(), workspace, strict)
    return LocalWorldModel(model=model), model


def test_restored_scene_equals_that_of_the_bag(run: Run) -> None:
    wm, model = world_model(WORKSPACE)
    extra = wm.add_element(Element("skiros:Product", "not in the bag")).id
    wanted = run.world(run.start + 5)
    done = restore(wm, wanted)
    assert (done.added, done.removed) == (len(wanted) - 1, 1)
    assert wm.find_element(extra) is None
    there = model.scene()
    assert set(there.relations()) == set(wanted.relations())
    assert content(there) == content(wanted)


def test_only_different_elements_are_changed(run: Run) -> None:
    wm, _ = world_model(WORKSPACE)
    restore(wm, run.world(run.start + 5))
    assert restore(wm, run.world(run.start + 5)) == Restored(0, 0, 0)
    done = restore(wm, run.world())
    assert (done.added, done.removed) == (0, 0) and done.changed > 0
    assert wm.get_relations("demo:Tray-12", "skiros:contain", "skiros:Product-14")


def test_unknown_names_reject_the_whole_scene(run: Run) -> None:
    wm, model = world_model(None, strict=True)
    with pytest.raises(WmException):
        restore(wm, run.world())
    assert len(model.scene()) == 1
