"""A caller that uses up its budget of query time is refused; no other caller is."""

from __future__ import annotations

import threading
import time

import pytest

from skiros2_world_model.core.local_world_model import source_ontologies
from skiros2_world_model.core.query_budget import BudgetUsedUp, QueryBudgets
from skiros2_world_model.core.world_model import WorldModel


def test_caller_without_budget_is_refused_until_some_has_returned(fake_clock):
    budgets = QueryBudgets(seconds=10.0, rate=0.1, clock=time.monotonic)
    for _ in range(2):
        with budgets.query("greedy"):
            fake_clock.advance(8.0)
    text = r"greedy: its queries have used up 10 s; it may ask again in \d+ s"
    with pytest.raises(BudgetUsedUp, match=text) as error, budgets.query("greedy"):
        pytest.fail("the query runs")
    assert error.value.code == "budget_used_up"
    with budgets.query("modest"), budgets.query(""):
        pass
    fake_clock.advance(100.0)
    with budgets.query("greedy"):
        pass


def test_failed_query_is_charged_as_well(fake_clock):
    budgets = QueryBudgets(seconds=1.0, rate=0.01, clock=time.monotonic)
    with pytest.raises(ValueError, match="no"), budgets.query("a"):
        fake_clock.advance(2.0)
        raise ValueError("no")
    with pytest.raises(BudgetUsedUp), budgets.query("a"):
        pytest.fail("the query runs")


def test_queries_of_a_caller_wait_for_each_other():
    budgets, running, end = QueryBudgets(parallel=2, patience=0.05), threading.Barrier(3), threading.Event()

    def run() -> None:
        with budgets.query("a"):
            running.wait()
            end.wait()

    threads = [threading.Thread(target=run) for _ in range(2)]
    for thread in threads:
        thread.start()
    running.wait()
    with pytest.raises(BudgetUsedUp, match="a: 2 queries are running"), budgets.query("a"):
        pytest.fail("the query runs")
    with budgets.query("b"):
        end.set()
    for thread in threads:
        thread.join()
    with budgets.query("a"):
        pass


def test_callers_are_forgotten_when_their_budget_is_full(fake_clock):
    budgets = QueryBudgets(clock=time.monotonic)
    for i in range(3000):
        with budgets.query(f"caller {i}"):
            fake_clock.advance(0.001)
    assert len(budgets._accounts) < 1500


def test_world_model_refuses_only_the_caller_that_used_up_its_budget():
    model = WorldModel(source_ontologies())
    model.knowledge_base.budgets = QueryBudgets(seconds=1e-6, rate=1e-9)
    assert model.query("ASK { ?s ?p ?o }", caller="greedy") == ["true"]
    with pytest.raises(BudgetUsedUp, match="greedy"):
        model.query("ASK { ?s ?p ?o }", caller="greedy")
    assert model.query("ASK { ?s ?p ?o }", caller="modest") == ["true"]
    assert model.query("ASK { ?s ?p ?o }") == ["true"]
    assert model.query("ASK {}", "ontology", caller="greedy") == ["true"]  # every client needs it to start
