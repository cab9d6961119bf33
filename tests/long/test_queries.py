"""Thousands of hostile queries, and kills of the processes that answer them: every other query gets its answer."""

from __future__ import annotations

import contextlib
import os
import random
import signal
import threading
import time

from skiros2_common.core.errors import SkirosError
from skiros2_common.core.operations import Add
from skiros2_common.core.world_element import Element
from skiros2_world_model.core.local_world_model import source_ontologies
from skiros2_world_model.core.query_store import WorkerStore
from skiros2_world_model.core.world_model import WorldModel

SEED, ATTACKS, SECONDS = 1, 300, 2.0
DOUBLED = " ".join(f"BIND(CONCAT(?v{i}, ?v{i}) AS ?v{i + 1})" for i in range(30))
HOSTILE = [
    "SELECT ?s " + "{" * 3000 + "?s ?p ?o" + "}" * 3000,
    "SELECT ?s { ?s ?p ?o FILTER(" + "(" * 5000 + "1" + ")" * 5000 + ") }",
    "SELECT ?s { ?s ?p ?o FILTER(" + "!" * 50_000 + "1) }",
    "SELECT (COUNT(*) AS ?n) { ?a ?b ?c . ?d ?e ?f . ?g ?h ?i FILTER(?a != ?i) }",
    "SELECT * { ?a ?b ?c . ?d ?e ?f . ?g ?h ?i }",
    "SELECT * { ?a ?b ?c . ?d ?e ?f . ?g ?h ?i } ORDER BY ?a ?i",
    f"SELECT (STRLEN(?v30) AS ?n) {{ BIND('0123456789' AS ?v0) {DOUBLED} }}",
    "SELECT * { SERVICE <http://192.0.2.1/> { ?s ?p ?o } }",
    "PREFIX h: <http://192.0.2.1/> SELECT * { ?a ?b ?c FILTER(?a!=?b||?a<?b)SERVICE#>\nh:{ ?x ?y ?z } }",
    "LOAD <http://192.0.2.1/>",
    "SELECT ?x { ?x (a|!a)*/(a|!a)*/(a|!a)* ?y }",
    "SELECT * { ?s ?p ?o FILTER(REGEX(STR(?s), '(a*)*b')) }",
    "\x00" * 100_000,
]


def processes() -> int:
    """The number of processes that descend from this one."""
    parents = {}
    for name in filter(str.isdigit, os.listdir("/proc")):
        try:
            with open(f"/proc/{name}/stat") as file:
                parents[int(name)] = int(file.read().rpartition(")")[2].split()[1])
        except OSError:
            continue
    mine, size = {os.getpid()}, 0
    while len(mine) != size:
        size = len(mine)
        mine |= {pid for pid, parent in parents.items() if parent in mine}
    return len(mine) - 1


def test_hostile_queries_and_kills_harm_no_other_query() -> None:
    store = WorkerStore(seconds=SECONDS, memory=300 << 20, rows=100_000)
    model = WorldModel(source_ontologies(), store=store)
    attacks, kills, answers = iter(range(ATTACKS)), iter(range(ATTACKS // 5)), 0
    failed: list[BaseException] = []

    def attack(number: int) -> None:
        chance = random.Random(SEED + number)
        for _ in attacks:
            try:
                model.query(chance.choice(HOSTILE))
            except SkirosError:
                continue
            except Exception as error:
                failed.append(error)

    def kill() -> None:
        chance = random.Random(SEED)
        for _ in kills:
            time.sleep(0.5)
            holder, idle = store._holder, list(store._idle)
            process = chance.choice([p for p in (holder, *idle) if p is not None] or [None])
            if process is not None and process.connection.fileno() >= 0:  # not ended by the store meanwhile
                with contextlib.suppress(ProcessLookupError):
                    os.kill(process.pid, signal.SIGKILL)

    threads = [threading.Thread(target=attack, args=(i,)) for i in range(3)]
    killer = threading.Thread(target=kill, daemon=True)
    for thread in (*threads, killer):
        thread.start()
    slowest = 0.0
    while any(thread.is_alive() for thread in threads):
        model.transact([Add(Element("skiros:Product", "one"))], "test")
        started = time.monotonic()
        assert model.query("SELECT (COUNT(*) AS ?n) { ?x a skiros:Product }") == [str(answers + 1)]
        slowest = max(slowest, time.monotonic() - started)
        answers += 1
        assert processes() < 20
    print(f"{answers} answers, the slowest after {slowest:.2f} s")
    assert not failed
    assert slowest < 10.0
    assert answers > 100
