"""Who listens to `wm/monitor` knows the whole scene, and notices when something was missed."""

import pytest

from skiros2_common.core.errors import WrongValue
from skiros2_demo.world_state import MonitorGap, WorldState
from support.recorded_run import PRODUCT, TRAY_A, TRAY_B, Monitor, element, moved, relation, scene


@pytest.fixture
def monitor() -> Monitor:
    return Monitor()


@pytest.fixture
def world(monitor: Monitor) -> WorldState:
    state = WorldState()
    state.apply(monitor("reset", *scene()))
    return state


def test_a_reset_gives_the_whole_scene(world: WorldState) -> None:
    assert set(world.things) == {TRAY_A, TRAY_B, PRODUCT}
    assert world.relations == {(TRAY_A, "skiros:contain", PRODUCT)}
    assert world.things[TRAY_A].properties == {"skiros:ContainerState": ["Full"]}


def test_a_relation_may_be_told_by_one_of_its_elements_alone(monitor: Monitor) -> None:
    state = WorldState()
    state.apply(monitor("reset", element(TRAY_A, "Tray A", [("-1", "skiros:contain", PRODUCT)]), element(PRODUCT, "")))
    assert state.holders(PRODUCT, "skiros:contain") == [TRAY_A]


def test_a_reset_forgets_what_was_before(world: WorldState, monitor: Monitor) -> None:
    world.apply(monitor("reset", element(TRAY_B, "Tray B")))
    assert set(world.things) == {TRAY_B}
    assert world.relations == set()


def test_an_update_replaces_properties_and_relations_of_the_element(world: WorldState, monitor: Monitor) -> None:
    world.apply(monitor("update", *moved()))
    assert world.holders(PRODUCT, "skiros:contain") == [TRAY_B]
    assert world.things[PRODUCT].properties == {"skiros:PositionX": [0.5]}


def test_an_element_that_is_added_is_there(world: WorldState, monitor: Monitor) -> None:
    world.apply(monitor("add", element("skiros:Product-15", "Product B", [(TRAY_B, "skiros:contain", "-1")])))
    assert world.holders("skiros:Product-15", "skiros:contain") == [TRAY_B]


@pytest.mark.parametrize("action", ["remove", "remove_recursive"])
def test_an_element_that_is_removed_takes_its_relations_along(world: WorldState, monitor: Monitor, action: str) -> None:
    world.apply(monitor(action, element(PRODUCT, "Product A")))
    assert PRODUCT not in world.things
    assert world.relations == set()


def test_single_relations_are_added_and_removed(world: WorldState, monitor: Monitor) -> None:
    world.apply(monitor("add", relation=[relation(TRAY_B, "skiros:contain", PRODUCT)]))
    world.apply(monitor("remove", relation=[relation(TRAY_A, "skiros:contain", PRODUCT)]))
    assert world.relations == {(TRAY_B, "skiros:contain", PRODUCT)}


def test_a_missing_change_is_noticed(world: WorldState, monitor: Monitor) -> None:
    monitor("update", *moved())
    with pytest.raises(MonitorGap, match="'update' by 'test' follows snapshot 's2', the last one seen is 's1'"):
        world.apply(monitor("update", *scene()))


def test_a_reset_mends_a_missing_change(world: WorldState, monitor: Monitor) -> None:
    monitor("update", *moved())
    world.apply(monitor("reset", *scene()))
    assert set(world.things) == {TRAY_A, TRAY_B, PRODUCT}


def test_a_property_that_cannot_be_read_is_named(world: WorldState, monitor: Monitor) -> None:
    broken = element(TRAY_A, "Tray A", ContainerState=["Full"])
    broken.properties[0].dataValue = "[Full"
    with pytest.raises(WrongValue, match="demo:Tray-10"):
        world.apply(monitor("update", broken))


def test_a_copy_does_not_change_with_the_world(world: WorldState, monitor: Monitor) -> None:
    before = world.copy()
    world.apply(monitor("update", *moved()))
    assert before.holders(PRODUCT, "skiros:contain") == [TRAY_A]


def test_a_thing_is_called_by_its_label_without_prefix_else_by_its_id(world: WorldState, monitor: Monitor) -> None:
    world.apply(monitor("add", element("cora:Robot-1", "demo:mobile_manipulator"), element("skiros:Part-2", "")))
    names = [world.name(i) for i in (PRODUCT, "cora:Robot-1", "skiros:Part-2", "skiros:Part-99")]
    assert names == ["Product A", "mobile_manipulator", "skiros:Part-2", "skiros:Part-99"]
