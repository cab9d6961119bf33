"""Random sequences of requests to a world model, good and bad, compared with a plain model of the scene after each.

With `FUZZ=50` in the environment there are 50 times as many runs, and other ones each time; see support/fuzz.py.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from hypothesis import HealthCheck, Phase, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule

from skiros2_common.core.element_content import relation_dict
from skiros2_common.core.operations import Add, Instantiate, Operation, Patch, Relate, Remove, Update
from skiros2_common.core.property import Property
from skiros2_common.core.world_element import Element, ElementChanges
from support.fuzz import examples
from support.scene_model import ROOT, Refusal, SceneModel, Thing

TYPES = ["skiros:Part", "skiros:LargeBox", "skiros:Starter", "lab:Crate", "lab:Pump", ":Part", "Product"]
PREDICATES = ["skiros:contain", "skiros:hasA", "lab:holds", "skiros:at", "skiros:hasSkill", "lab:feeds", "contain"]
LABELS = ["", "one", "two", "lab:kit", 'a "red" one\nwith é\t\\', "日本\x00"]
KEYS = ["lab:size", "lab:count", "lab:open", "lab:note", "lab:anything", "skiros:anything", "other"]
VALUES: list[Any] = [
    *(0.5, -2.25, 0.0, 1e300, float("inf"), float("nan"), 1, 0, -7, 2**70, True, False),
    *("", "a text", "0.25", "12", "true", "left", "\n\"'\\", "x" * 5000, "日本\x00", [1, "two"], {"three": [None]}),
]
FILTERS = ["skiros:sceneProperty", "skiros:spatiallyRelated", "skiros:contain", "skiros:hasSkill", "lab:feeds"]

#: What cannot be a name, an id, a value. Each is refused.
BAD_NAMES = [
    "",
    ":",
    "skiros:",
    "a b",
    "lab:x>",
    "lab:[x",
    "lab:50%",
    "lab:a#b",
    "lab:\x01",
    "\ud800",
    "lab:\n",
    "http://a b",
]
BAD_VALUES = [("lab:size", 10**400), ("lab:count", 1.5), ("lab:open", 2), ("lab:note", 1), ("lab:anything", "\ud800")]
NOBODY = ["", "skiros:Part-9001", "-1", "#nothing", "nobody", "skiros:Part", "a b", "x-" + "9" * 5000, "\ud800"]


_PREFIXES = b"@prefix : <http://rvmi.aau.dk/ontologies/skiros.owl#> .\n@prefix lab: <http://x.org/lab.owl#> .\n"
FILES = {
    "broken.ttl": b"@prefix a: <http://x.org/a.owl#> .\na:b a:c none:d .\n",
    "binary.ttl": bytes(range(256)),
    "broken_xml.ttl": b"<?xml version='1.0'?><rdf:RDF>",
    "rootless.ttl": _PREFIXES + b":Part-1 a :Part .",
    "folder/in_it.ttl": _PREFIXES,
}
#: Files that cannot be loaded, and what the refusal names.
BAD_FILES = {
    "no_such.ttl": "no_such.ttl",
    "../saved.ttl": "saved.ttl: expected a file in the workspace",
    "/etc/passwd": "/etc/passwd: expected a file in the workspace",
    "a/../../saved.ttl": "saved.ttl: expected a file in the workspace",
    ".": "expected a file in the workspace",
    "folder": "folder",
    "lab\x00.ttl": "lab",
    "\ud800.ttl": "ttl",
    "x" * 5000: "xxx",
    "broken.ttl": "broken.ttl, line 2",
    "binary.ttl": "binary.ttl",
    "broken_xml.ttl": "broken_xml.ttl",
    "rootless.ttl": "rootless.ttl: there is no skiros:Scene-0",
}
BAD_TARGETS = ["../out.ttl", "/tmp/out.ttl", "folder", "no/such/folder.ttl", "a\x00b", "\ud800"]


def fuzz_settings(number: int, steps: int) -> settings:
    """How many runs a machine has, and how many steps each."""
    return settings(
        max_examples=examples(number),
        stateful_step_count=steps,
        suppress_health_check=list(HealthCheck),
        phases=set(Phase) - {Phase.explain, Phase.reuse},  # explaining traces each line, which takes minutes
    )


@dataclass
class Answer:
    """What came of a request: for each operation its id, and the elements that were announced as added, in order."""

    ids: list[str]
    added: list[str]


class Refused(Exception):
    """The world model has refused, with this text."""


class WorldModelMachine(RuleBasedStateMachine):
    """The rules. Subclasses define the access to the world model."""

    @abstractmethod
    def open(self) -> None:
        """Makes a world model with a blank scene, in whose workspace is the ontology `LAB`."""

    @abstractmethod
    def transact(self, operations: Sequence[Operation]) -> Answer:
        """Sends a request; raises `Refused`."""

    @abstractmethod
    def state(self) -> tuple[str, SceneModel]:
        """The name of the present state, and the scene."""

    @abstractmethod
    def files(self, action: str, filename: str) -> None:
        """Loads or saves the scene; raises `Refused`."""

    @abstractmethod
    def write(self, filename: str, content: bytes) -> None:
        """Puts a file into the workspace."""

    @initialize()
    def begin(self) -> None:
        self.open()
        self.snapshot_id, self.scene = self.state()
        assert set(self.scene.things) == {ROOT} and not self.scene.relations

    def sendable(self, texts: Sequence[str]) -> Sequence[str]:
        """Those of the texts that can be sent to the world model."""
        return texts

    # -- drawing -----------------------------------------------------------------------------------------------

    def draw_id(self, data: st.DataObject) -> str:
        return data.draw(st.sampled_from(sorted(self.scene.things)), "id")

    def draw_relation(self, data: st.DataObject, eid: str = "-1") -> dict[str, Any]:
        pred = data.draw(st.sampled_from(PREDICATES), "predicate")
        individuals = ["lab:kit", "lab:shelf", "nothing_special"] if pred in ("skiros:at", "lab:feeds") else []
        other = data.draw(st.sampled_from([*sorted(self.scene.things), *individuals]), "other end")
        if other in individuals or data.draw(st.booleans(), "outgoing"):
            return relation_dict(eid, pred, other)
        return relation_dict(other, pred, eid)

    def draw_element(self, data: st.DataObject, eid: str = "") -> Element:
        element = Element(data.draw(st.sampled_from(TYPES)), data.draw(st.sampled_from(LABELS)), eid)
        for key, value in data.draw(
            st.dictionaries(st.sampled_from(KEYS), st.sampled_from(VALUES), max_size=3)
        ).items():
            element.property_view[key] = _property(key, [value])
        if data.draw(st.integers(0, 4)) == 0:
            element.property_view["lab:note"] = Property(
                "lab:note", data.draw(st.lists(st.sampled_from(["a", "b"]), max_size=2))
            )
            element.property_view["skiros:Template"] = Property("skiros:Template", "lab:kit")
        relations = [self.draw_relation(data) for _ in range(data.draw(st.integers(0, 2)))]
        element._relations = relations
        return element

    def draw_operation(self, data: st.DataObject, references: list[str]) -> Operation:
        kind = data.draw(
            st.sampled_from(["add"] * 3 + ["update", "patch", "patch", "relate", "relate", "remove"]), "kind"
        )
        if kind == "add":
            wish = data.draw(st.sampled_from(["", "", "skiros:Part-{}", "odd-{}"])).format(
                data.draw(st.integers(0, 20))
            )
            element = self.draw_element(data, wish)
            if references and data.draw(st.booleans()):
                relation = relation_dict("-1", "skiros:contain", f"#{data.draw(st.sampled_from(references))}")
                element._relations = [*element.relation_view, relation]
            references.append(str(len(references)))
            return Add(element, references[-1])
        eid = self.draw_id(data)
        if kind == "update":
            keys = data.draw(st.sampled_from([None, None, frozenset(["lab:size", "lab:note"])]))
            return Update(self.draw_element(data, eid), data.draw(st.booleans()), keys)
        if kind == "patch":
            return Patch(eid, self.draw_changes(data, eid))
        if kind == "remove":
            filters = data.draw(st.sampled_from(FILTERS)), data.draw(st.sampled_from(["", "", "skiros:Part"]))
            return Remove(eid, data.draw(st.booleans()), *filters)
        relation = self.draw_relation(data, eid)
        if self.scene.relations and data.draw(st.booleans()):
            relation = relation_dict(*data.draw(st.sampled_from(sorted(self.scene.relations))))
        return Relate(relation["src"], relation["type"], relation["dst"], data.draw(st.booleans(), "value"))

    def draw_changes(self, data: st.DataObject, eid: str) -> ElementChanges:
        element = self.draw_element(data)
        own = sorted(r for r in self.scene.relations if eid in (r[0], r[2]))
        return ElementChanges(
            element.property_view,
            data.draw(st.lists(st.sampled_from(KEYS), max_size=1)),
            list(element.relation_view),
            [relation_dict(*r) for r in (data.draw(st.lists(st.sampled_from(own), max_size=1)) if own else [])],
            data.draw(st.sampled_from([None, "renamed", *LABELS])),
            data.draw(st.sampled_from([None, None, *TYPES])),
        )

    def draw_bad_operation(self, data: st.DataObject) -> Operation:
        """One that has to be refused, or at least looks so."""
        name = data.draw(st.sampled_from(self.sendable(BAD_NAMES)), "bad name")
        nobody = data.draw(st.sampled_from(self.sendable(NOBODY)), "nobody")
        key, value = data.draw(st.sampled_from(BAD_VALUES))
        eid, element = self.draw_id(data), self.draw_element(data)
        kind = data.draw(st.integers(0, 13), "kind")
        if kind == 0:
            element.type = name
        elif kind == 1:
            element._properties = {name: _property(name, [1])}
        elif kind == 2:
            element._properties = {key: _property(key, [value])}
        elif kind == 3:
            element._relations = [relation_dict(nobody, "skiros:contain", "-1")]
        elif kind == 4:
            element._relations = [relation_dict("-1", "skiros:at", nobody)]
        elif kind == 5:
            element._relations = [relation_dict("-1", name, ROOT)]
        elif kind == 6:
            return Update(Element("skiros:Part", "", nobody))
        elif kind == 7:
            return Patch(nobody, ElementChanges(label="lost"))
        elif kind == 8:
            return Remove(nobody, data.draw(st.booleans()))
        elif kind == 9:
            return Relate(eid, "skiros:contain", eid)
        elif kind == 10:
            return Relate(nobody, "skiros:at", eid, data.draw(st.booleans()))
        elif kind == 11:
            return Relate(eid, "skiros:at", nobody, data.draw(st.booleans()))
        elif kind == 12:
            return Instantiate(data.draw(st.sampled_from(["lab:nothing", "skiros:Part-9001", name])))
        else:
            return Remove(ROOT, False)
        return Add(element) if data.draw(st.booleans()) else Update(Element.shared(
            element.type, element.label, eid, element.property_view, element.relation_view))  # fmt: skip

    # -- the rules ---------------------------------------------------------------------------------------------

    @rule(data=st.data())
    def request(self, data: st.DataObject) -> None:
        """A request of some operations, which belong together."""
        references: list[str] = []
        count = data.draw(st.integers(1, 4))
        self.send([self.draw_operation(data, references) for _ in range(count)])

    @rule(data=st.data())
    def bad_request(self, data: st.DataObject) -> None:
        """A request of which one operation is bad."""
        references: list[str] = []
        operations = [self.draw_operation(data, references) for _ in range(data.draw(st.integers(0, 2)))]
        operations.insert(data.draw(st.integers(0, len(operations))), self.draw_bad_operation(data))
        self.send(operations)

    @rule(data=st.data())
    def copy_of_a_template(self, data: st.DataObject) -> None:
        name = data.draw(st.sampled_from(["lab:kit", "lab:bolt", "lab:shelf", "http://x.org/lab.owl#lid"]))
        filters = data.draw(st.sampled_from([["skiros:hasA", "skiros:contain"], ["skiros:hasA"], ["lab:holds"]]))
        known = data.draw(st.sampled_from([frozenset(), frozenset(["lab:bolt"])]))
        relations = [self.draw_relation(data)]
        self.send([Instantiate(name, data.draw(st.booleans()), relations, filters, known)])

    @rule(twice=st.booleans())
    def save_and_load(self, twice: bool) -> None:
        """A saved scene loads unchanged, and saving it again gives the same file."""
        self.files("save", "saved.ttl")
        self.files("load", "saved.ttl")
        self.scene = self.scene.as_read_from_a_file()
        self.snapshot_id = self.state()[0]

    @rule(data=st.data())
    def load_of_a_bad_file(self, data: st.DataObject) -> None:
        for name, content in FILES.items():
            self.write(name, content)
        filename = data.draw(st.sampled_from(self.sendable(sorted(BAD_FILES))), "file")
        self.refused(lambda: self.files("load", filename), BAD_FILES[filename])

    @rule(data=st.data())
    def save_to_a_bad_file(self, data: st.DataObject) -> None:
        self.write("folder/in_it.ttl", b"")
        filename = data.draw(st.sampled_from(self.sendable(BAD_TARGETS)), "file")
        self.refused(lambda: self.files("save", filename), repr(filename)[1:-1])

    @invariant()
    def the_scene_is_as_it_should_be(self) -> None:
        if hasattr(self, "scene"):
            snapshot_id, scene = self.state()
            assert scene.comparable() == self.scene.comparable()
            assert snapshot_id == self.snapshot_id

    # -- shared ------------------------------------------------------------------------------------------------

    def send(
        self, operations: Sequence[Operation], transact: Callable[[Sequence[Operation]], Answer] | None = None
    ) -> None:
        """A request that is carried out as the model says, or refused as it says.

        :param transact: another way to send it.
        """
        transact = transact or self.transact
        culprits = self.culprits(operations)
        if culprits:
            self.refused(lambda: transact(operations), *culprits)
            return
        answer = transact(operations)
        given = zip(answer.ids, operations, strict=False)
        ids = [eid for eid, operation in given if isinstance(operation, Add)]
        if any(isinstance(operation, Instantiate) for operation in operations):
            ids = answer.added
        self.scene = self.scene.after(operations, iter(ids))
        self.snapshot_id = self.state()[0]

    def culprits(self, operations: Sequence[Operation]) -> list[str]:
        """The possible reasons of a refusal; none for a valid request."""
        found: list[str] = []
        for some in (operations, *([operation] for operation in operations)):
            try:
                self.scene.after(some)
            except Refusal as refusal:
                found += refusal.args
            if not found:
                break
        return found

    def refused(self, call: Any, *culprits: str) -> None:
        """It is refused, and the text names one of these."""
        try:
            call()
        except Refused as refused:
            said = str(refused)
            assert any(c in said or repr(c)[1:-1] in said for c in culprits), f"none of {culprits} is in: {said}"
        else:
            raise AssertionError(f"not refused, because of {culprits}")


def thing_of(element: Any) -> Thing:
    """What an element or node of the scene holds."""
    properties = element.property_view if isinstance(element, Element) else element.properties
    return Thing(element.type, element.label, {key: list(p.values) for key, p in properties.items()})


def _property(key: str, values: list[Any]) -> Property:
    """A property as one makes it that has not asked for its type."""
    prop = Property(key, type(values[0]))
    prop.current = list(values)
    return prop
