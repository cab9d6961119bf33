"""Where elements and robots were at earlier times."""

from __future__ import annotations

from skiros2_gateway.core.scene_history import SceneHistory


def test_value_holds_until_the_next_one() -> None:
    history = SceneHistory()
    for time, value in ((1.0, "a"), (2.0, "b"), (3.0, None), (4.0, "c")):
        history.add("elements", "Box-1", time, value)
    found = [history.at(time)["elements"].get("Box-1") for time in (0.9, 1.0, 1.9, 2.0, 3.5, 9.0)]
    assert found == [None, "a", "a", "b", None, "c"]


def test_last_of_quick_changes_is_kept() -> None:
    history = SceneHistory()
    for number in range(100):  # 25 Hz for 4 s
        history.add("frames", "tool", number * 0.04, number)
    assert history.at(99.0)["frames"]["tool"] == 99
    shown = {history.at(number * 0.04)["frames"]["tool"] for number in range(100)}
    assert 10 < len(shown) < 30


def test_long_history_keeps_its_later_part_and_what_does_not_move() -> None:
    history = SceneHistory(max_entries=1000)
    history.add("frames", "table", 0.0, "here")
    for second in range(5000):
        history.add("frames", "tool", float(second), second)
    assert [history.at(float(time))["frames"]["tool"] for time in (4600, 4999)] == [4600, 4999]
    assert history.at(100.0)["frames"]["tool"] > 3000
    assert history.at(4999.0)["frames"]["table"] == "here"


def test_history_of_a_key_that_appears_late_is_kept() -> None:
    history = SceneHistory(max_entries=1000)
    for second in range(990):
        history.add("frames", "tool", float(second), second)
    for second in range(990, 1010):
        history.add("elements", "Box-1", float(second), f"v{second}")
    assert history.at(992.0)["elements"]["Box-1"] == "v992"
    assert "Box-1" not in history.at(900.0)["elements"]


def test_removed_elements_leave_nothing_behind() -> None:
    history = SceneHistory(max_entries=1000)
    for second in range(20_000):
        history.add("elements", f"Box-{second}", float(second), "here")
        history.add("elements", f"Box-{second}", second + 0.5, None)
    assert len(history._entries) < 2000
    assert history.at(19_999.2)["elements"] == {"Box-19999": "here"}


def test_many_keys_with_one_entry_each_are_kept() -> None:
    history = SceneHistory(max_entries=100)
    for number in range(1000):
        history.add("elements", f"Box-{number}", 0.0, number)
    assert len(history.at(1.0)["elements"]) == 1000
