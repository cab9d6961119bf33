"""Edits that a program proposes: checked and previewed on a copy, applied as a whole to the unchanged scene."""

from __future__ import annotations

import pytest

from skiros2_common.core.world_element import Element
from skiros2_gateway.core.edits import Edits, PropertyEdit, RelationEdit, apply_edits, preview_edits
from skiros2_gateway.core.problems import Rejected
from skiros2_world_model.core.local_world_model import LocalWorldModel
from skiros2_world_model.core.wm_errors import WmException

ROOT = "skiros:Scene-0"


@pytest.fixture(scope="module")
def wm() -> LocalWorldModel:
    return LocalWorldModel()


def add(wm: LocalWorldModel, cls: str, inside: str = ROOT) -> str:
    element = Element(cls)
    element.addRelation(inside, "skiros:contain", "-1")
    return str(wm.add_element(element).id)


def weight(eid: str, *values: float | str) -> PropertyEdit:
    return PropertyEdit(element=eid, property="skiros:Weight", values=list(values))


def contain(subject: str, eid: str, holds: bool = True, relation: str = "skiros:contain") -> RelationEdit:
    return RelationEdit(subject=subject, relation=relation, object=eid, holds=holds)


def test_edits_are_previewed_without_a_change_and_applied_as_a_whole(wm: LocalWorldModel) -> None:
    place, other = add(wm, "skiros:Location"), add(wm, "skiros:Location")
    product = add(wm, "skiros:Product", place)
    edits = Edits((weight(product, 2.0),), (contain(place, product, False), contain(other, product)))
    preview = preview_edits(wm, edits)
    assert preview.lines == (
        f"{place} no longer contains {product}", f"{other} contains {product}", f"weight of {product} is 2",
    )  # fmt: skip
    assert wm.get_element(product).value_of("skiros:Weight") is None
    apply_edits(wm, edits, preview)
    assert wm.get_element(product).value_of("skiros:Weight") == 2.0
    assert [e.id for e in wm.get_branch(other)] == [other, product]
    changed = preview_edits(wm, Edits((weight(product, 2.5),)))
    assert changed.lines == (f"weight of {product} is 2.5 (was 2)",)
    removal = Edits((weight(product),))
    assert preview_edits(wm, removal).lines == (f"weight of {product} is no longer 2",)
    apply_edits(wm, removal, preview_edits(wm, removal))
    assert wm.get_element(product).value_of("skiros:Weight") is None


def test_wrong_edits_are_rejected_with_all_problems(wm: LocalWorldModel, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(LocalWorldModel, "query_table", None)  # agents cannot use up the gateway's budget of queries
    product = add(wm, "skiros:Product")
    edits = Edits(
        (
            weight("skiros:Product-999", 1.0),
            weight(product, "heavy"),
            PropertyEdit(element=product, property="skiros:Wieght", values=[1.0]),
            PropertyEdit(element=product, property="skiros:Weight", values=[1.0, "x"]),
        ),
        (
            contain(product, "skiros:Nothing-1"),
            contain(ROOT, product, relation="skiros:contian"),
            contain(product, ROOT),
        ),
    )
    with pytest.raises(Rejected) as rejected:
        preview_edits(wm, edits)
    problems = {problem.where: problem for problem in rejected.value.problems}
    assert set(problems) == {
        "properties.0.element", "properties.1", "properties.2", "properties.3", "relations.0.object", "relations.1",
        "relations.2",
    }  # fmt: skip
    assert product in problems["properties.0.element"].nearest
    assert problems["properties.2"].nearest[0] == "skiros:Weight"
    assert problems["relations.1"].nearest[0] == "skiros:contain"


def test_edits_that_change_nothing_are_rejected(wm: LocalWorldModel) -> None:
    product = add(wm, "skiros:Product")
    with pytest.raises(Rejected, match="has these values already"):
        preview_edits(wm, Edits(relations=(contain(ROOT, product),)))


def test_edits_are_refused_after_another_change_of_their_elements(wm: LocalWorldModel) -> None:
    product = add(wm, "skiros:Product")
    edits = Edits((weight(product, 2.0),))
    preview = preview_edits(wm, edits)
    element = wm.get_element(product)
    element.setProperty("skiros:Weight", 1.0)
    wm.update_element(element)
    with pytest.raises(WmException, match="was changed"):
        apply_edits(wm, edits, preview)
    assert wm.get_element(product).value_of("skiros:Weight") == 1.0
