"""Answers whose elements are serialized once for each state."""

from __future__ import annotations

from io import BytesIO
from pathlib import Path

import genpy

from skiros2_common.core.element_content import ElementChanges
from skiros2_common.core.operations import SCENE, Add, Patch, Relate, Remove
from skiros2_common.core.property import Property
from skiros2_common.core.world_element import Element
from skiros2_common.ros.utils import element2msg, relation2msg
from skiros2_msgs import msg as msgs
from skiros2_msgs import srv as srvs
from skiros2_world_model.core.local_world_model import source_ontologies
from skiros2_world_model.core.world_model import WorldModel
from skiros2_world_model.ros.element_answer import (
    ChangeMessage,
    ElementAnswer,
    ElementBytes,
    ModifyAnswer,
    TransactionAnswer,
)


def _received(answer: ElementAnswer) -> srvs.WmGetResponse:
    buffer = BytesIO()
    answer.serialize(buffer)
    return srvs.WmGetResponse().deserialize(buffer.getvalue())


def _read(model: WorldModel, known: ElementBytes, ids: list[str]) -> srvs.WmGetResponse:
    """The answer for elements, which must be the same as that of the generated code."""
    elements = [model.reader.find(eid, SCENE) for eid in ids]
    assert all(elements)
    received = _received(ElementAnswer("state", [known.of(e, SCENE) for e in elements if e]))
    assert received == srvs.WmGetResponse("state", [element2msg(e) for e in elements])
    return received


def _add(model: WorldModel, number: int) -> str:
    element = Element("skiros:Product", f"prödukt {number}", f"skiros:Product-{number}")
    element.setProperty("skiros:Weight", float(number))
    return model.transact([Add(element)], "test").ids[0]


def test_answer_has_the_present_state_after_each_change(tmp_path: Path) -> None:
    model, known = WorldModel(source_ontologies(), tmp_path), ElementBytes()
    box, other = _add(model, 1), _add(model, 2)
    before = _read(model, known, [box, other])
    assert _read(model, known, [box, other]) == before
    heavier = ElementChanges({"skiros:Weight": Property("skiros:Weight", 7.0)})
    model.transact([Patch(box, heavier)], "test")
    assert "7.0" in str(_read(model, known, [box, other]).elements[0].properties)
    model.transact([Relate(box, "skiros:contain", other, True)], "test")
    assert any(r.objectId == other for r in _read(model, known, [box, other]).elements[0].relations)
    model.transact([Relate(box, "skiros:contain", other, False)], "test")
    assert not any(r.objectId == other for r in _read(model, known, [box, other]).elements[0].relations)


def test_elements_of_the_same_id_in_two_contexts_stay_apart() -> None:
    known = ElementBytes()
    one, other = (Element.shared("skiros:Product", label, "skiros:Product-1", {}, (), 5) for label in ("one", "other"))
    for element, context in ((one, SCENE), (other, "plan"), (one, SCENE), (other, ""), (one, "")):
        received = _received(ElementAnswer("state", [known.of(element, context)]))
        assert received.elements == [element2msg(element)]


def test_answer_without_elements_is_empty() -> None:
    assert _received(ElementAnswer("state", [])) == srvs.WmGetResponse("state", [])


def test_author_and_subscribers_receive_what_the_generated_code_would_send(tmp_path: Path) -> None:
    model, known = WorldModel(source_ontologies(), tmp_path), ElementBytes()
    box, other = _add(model, 1), _add(model, 2)
    for operation in (
        Add(Element("skiros:Product", "prödukt")),
        Relate(box, "skiros:contain", other),
        Remove(box, True),
    ):
        outcome = model.transact([operation], "test")
        sent = [ChangeMessage(c, [known.of(e, "") for e in c.elements]) for c in outcome.changes]
        plain = [
            msgs.WmMonitor(
                *(c.prev_snapshot_id, c.snapshot_id, genpy.Time.from_sec(c.stamp), c.author, c.action),
                *([element2msg(e) for e in c.elements], [relation2msg(r) for r in c.relations]),
            )
            for c in outcome.changes
        ]
        assert plain and _sent(TransactionAnswer(outcome.ids, sent)) == _sent(
            srvs.WmTransactionResponse(outcome.ids, plain)
        )
        assert list(map(_sent, sent)) == list(map(_sent, plain))
        elements = outcome.changes[0].elements
        assert _sent(ModifyAnswer([known.of(e, "") for e in elements])) == _sent(
            srvs.WmModifyResponse([element2msg(e) for e in elements])
        )


def _sent(message: genpy.Message) -> bytes:
    buffer = BytesIO()
    message.serialize(buffer)
    return buffer.getvalue()
