"""Allocation of robots and devices to goals."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from skiros2_task.core.resources import Resources


def request(resources: Resources, owner: str, wanted: str, priority: int = 0, in_use: str = "") -> list[str]:
    return resources.request(owner, priority, frozenset(wanted), frozenset(in_use))


def test_free_resources_are_granted_at_once() -> None:
    resources = Resources()
    assert request(resources, "one", "ab") == ["one"]
    assert request(resources, "two", "bc") == []
    assert resources.held_by_others("one") == set()
    assert request(resources, "one", "a") == ["one", "two"], "what is not wanted any more is given to the other"
    assert resources.held_by_others("one") == set("bc")
    assert request(resources, "one", "") == ["one"]
    assert resources.release("two") == []


def test_higher_priority_is_granted_first() -> None:
    resources = Resources()
    request(resources, "first", "a")
    assert request(resources, "low", "a") == []
    assert request(resources, "high", "ab", priority=2) == []
    assert request(resources, "later", "b", priority=1) == [], "b is kept for the more urgent one"
    assert resources.release("first") == ["high"]
    assert resources.release("high") == ["later", "low"]


def test_waiting_goal_releases_unused_resources() -> None:
    resources = Resources()
    request(resources, "one", "ab")
    request(resources, "two", "c")
    assert request(resources, "two", "bc") == [], "it waits for b"
    assert request(resources, "one", "abc", in_use="a") == ["one"], "c was given back"
    assert resources.release("one") == ["two"]


def test_goal_knows_the_goals_of_lower_priority_that_hold_what_it_waits_for() -> None:
    resources = Resources()
    request(resources, "low", "ab")
    request(resources, "equal", "c", priority=2)
    request(resources, "high", "bcd", priority=2)
    assert resources.lower_holders("high") == {"low": frozenset("b")}
    assert request(resources, "low", "b", in_use="b") == ["low"]
    assert request(resources, "low", "") == ["low"]
    assert resources.lower_holders("high") == {}
    assert resources.release("equal") == ["high"]


OWNERS = st.sampled_from(["one", "two", "three"])
ACTIONS = st.lists(st.tuples(OWNERS, st.integers(0, 2), st.frozensets(st.sampled_from("abcd"))), max_size=30)


@given(ACTIONS)
def test_resources_are_exclusive_and_every_request_is_granted(actions: list[tuple[str, int, frozenset[str]]]) -> None:
    resources, held, wanted = Resources(), dict[str, frozenset[str]](), dict[str, frozenset[str]]()
    for owner, priority, wants in actions:
        wanted[owner] = wants
        held.pop(owner, None)
        for served in resources.request(owner, priority, wants, frozenset()):
            held[served] = wanted[served]
        taken = [name for names in held.values() for name in names]
        assert len(taken) == len(set(taken))
    while held:
        owner = min(held)
        del held[owner], wanted[owner]
        held.update({served: wanted[served] for served in resources.release(owner)})
    assert not wanted, "somebody waits for ever"
