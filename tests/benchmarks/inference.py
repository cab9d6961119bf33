"""Finding elements for unset parameters among a thousand of each class, beside the same question in SPARQL.

The peer is the world model's own store (Oxigraph), which answers joins fast; it knows the same relations and values.
Both search for an open tray, a part of more than some weight in it, and an area that the part refers to and that has
the tray.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator

from benchmarks.measurement import Measurement, paired
from skiros2_common.core.abstract_skill import SkillDescription
from skiros2_common.core.params import ParamHandler, ParamTypes
from skiros2_common.core.world_element import Element
from skiros2_skill.core.engine.inference import failure_text, filter_candidates, infer
from skiros2_world_model.core.local_world_model import LocalWorldModel

RUNS = 9
OF_EACH = 1000
_KEYS = {"Tray": "skiros:LargeBox", "Part": "skiros:Product", "Area": "skiros:LocationArea"}
_QUERY = """SELECT ?tray ?part ?area WHERE {{
    ?tray skiros:State "Open" . ?tray skiros:contain ?part . ?part skiros:Weight ?weight . FILTER(?weight > {weight})
    ?part skiros:partReference ?area . ?area skiros:hasA ?tray }}"""


def measure() -> Iterator[Measurement]:
    """The rows. Of some weights there is one fitting part, of a greater one none."""
    wmi = _scene()
    heavy = float(OF_EACH - OF_EACH // 20)
    yield _row(wmi, "the elements for three linked parameters found, 1000 of each class", heavy, True)
    yield _row(wmi, "none found for three linked parameters, with the reasons", 2.0 * OF_EACH, False)


def _row(wmi: LocalWorldModel, name: str, weight: float, found: bool) -> Measurement:
    query = _QUERY.format(weight=weight)
    assert bool(wmi.query_ontology(query)) is found, "both are asked the same"

    def ours() -> None:
        params = ParamHandler()
        for key, etype in _KEYS.items():
            params.addParam(key, Element(etype), ParamTypes.Required)
        failed = infer(params, _conditions(weight), wmi)
        assert (failed is None) is found
        if failed is not None:
            failure_text(failed, filter_candidates(failed))

    asked = _timed(lambda: wmi.query_ontology(query))
    return paired(name, _timed(ours), "one SPARQL query", asked, unit="ms", runs=RUNS)


def _conditions(weight: float) -> list[object]:
    make = SkillDescription()
    return [
        make.getRelationCond("In", "skiros:contain", "Tray", "Part", True),
        make.getRelationCond("Refers", "skiros:partReference", "Part", "Area", True),
        make.getRelationCond("Has", "skiros:hasA", "Area", "Tray", True),
        make.getPropCond("Open", "skiros:State", "Tray", "=", "Open", True),
        make.getPropCond("Heavy", "skiros:Weight", "Part", ">", weight, True),
    ]


def _scene() -> LocalWorldModel:
    """Each tray has a part, every second tray is open; each part refers to an area, which has its tray or another."""
    wmi = LocalWorldModel("bench")
    trays, parts, areas = ([Element(etype, "e") for _ in range(OF_EACH)] for etype in _KEYS.values())
    for number, (tray, part) in enumerate(zip(trays, parts, strict=True)):
        tray.setProperty("skiros:State", "Shut" if number % 2 else "Open")
        part.setProperty("skiros:Weight", float(number))
    wmi.add_elements([*trays, *parts, *areas])
    for number, (tray, part, area) in enumerate(zip(trays, parts, areas, strict=True)):
        wmi.set_relation(tray.id, "skiros:contain", part.id)
        wmi.set_relation(part.id, "skiros:partReference", area.id)
        wmi.set_relation(area.id, "skiros:hasA", trays[number if number == OF_EACH - 2 else (number + 2) % OF_EACH].id)
    return wmi


def _timed(call: Callable[[], object]) -> Callable[[], float]:
    """The time of a call (ms)."""

    def timed() -> float:
        start = time.perf_counter()
        call()
        return (time.perf_counter() - start) * 1e3

    return timed
