"""Robots and devices that several goals want."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from skiros2_task.core.claims import Claims


def want(claims: Claims, owner: str, wanted: str, priority: int = 0, in_use: str = "") -> list[str]:
    return claims.want(owner, priority, frozenset(wanted), frozenset(in_use))


def test_what_is_free_is_given_at_once_and_what_is_not_later() -> None:
    claims = Claims()
    assert want(claims, "one", "ab") == ["one"]
    assert want(claims, "two", "bc") == []
    assert claims.held_by_others("one") == set()
    assert want(claims, "one", "a") == ["one", "two"], "what is not wanted any more is given to the other"
    assert claims.held_by_others("one") == set("bc")
    assert want(claims, "one", "") == ["one"]
    assert claims.drop("two") == []


def test_the_higher_priority_goes_first_and_is_not_overtaken() -> None:
    claims = Claims()
    want(claims, "first", "a")
    assert want(claims, "low", "a") == []
    assert want(claims, "high", "ab", priority=2) == []
    assert want(claims, "later", "b", priority=1) == [], "b is kept for the more urgent one"
    assert claims.drop("first") == ["high"]
    assert claims.drop("high") == ["later", "low"]


def test_those_that_wait_give_back_what_they_do_not_use() -> None:
    claims = Claims()
    want(claims, "one", "ab")
    want(claims, "two", "c")
    assert want(claims, "two", "bc") == [], "it waits for b"
    assert want(claims, "one", "abc", in_use="a") == ["one"], "c was given back"
    assert claims.drop("one") == ["two"]


OWNERS = st.sampled_from(["one", "two", "three"])
ACTIONS = st.lists(st.tuples(OWNERS, st.integers(0, 2), st.frozensets(st.sampled_from("abcd"))), max_size=30)


@given(ACTIONS)
def test_nothing_is_given_twice_and_at_the_end_all_are_served(actions: list[tuple[str, int, frozenset[str]]]) -> None:
    claims, held, wanted = Claims(), dict[str, frozenset[str]](), dict[str, frozenset[str]]()
    for owner, priority, wants in actions:
        wanted[owner] = wants
        held.pop(owner, None)
        for served in claims.want(owner, priority, wants, frozenset()):
            held[served] = wanted[served]
        taken = [name for names in held.values() for name in names]
        assert len(taken) == len(set(taken))
    while held:
        owner = min(held)
        del held[owner], wanted[owner]
        held.update({served: wanted[served] for served in claims.drop(owner)})
    assert not wanted, "somebody waits for ever"
