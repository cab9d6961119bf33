"""Elements as libraries create, read and change them. Compatibility, section 6."""

import copy
import datetime

import pytest

from compatibility.rules import rule
from skiros2_common.core.discrete_reasoner import DiscreteReasoner, reasoners
from skiros2_common.core.world_element import Element


@pytest.fixture
def bench(skill_bench):
    """A scene with a product in one of two trays."""
    skill_bench.tray = skill_bench.add("skiros:LargeBox", "tray")
    skill_bench.other_tray = skill_bench.add("skiros:LargeBox", "other tray")
    skill_bench.product = skill_bench.add("skiros:Product", "product", skill_bench.tray)
    return skill_bench


@pytest.fixture
def box():
    element = Element("skiros:LargeBox", "box", "skiros:LargeBox-7")
    element.addRelation("-1", "skiros:contain", "skiros:Part-1")
    element.addRelation("-1", "skiros:contain", "skiros:Part-2", abstract=True)
    element.addRelation("skiros:Scene-0", "skiros:contain", "-1")
    return element


def ends(relations):
    return [(r["src"], r["type"], r["dst"]) for r in relations]


# -- names ---------------------------------------------------------------------------------------------------------


@rule(
    "element", "Names of properties and relations are kept as written", better="`X`, `:X`, `skiros:X` find each other"
)
def test_names_are_kept_as_written():
    element = Element("Product")
    element.setProperty("Hello", 1)
    element.addRelation("-1", "pred", "x")
    assert element.available_properties == ["Hello"]
    assert element.getProperty("Hello").key == "Hello"
    assert element.getRelations()[0]["type"] == "pred"
    assert element.hasProperty("skiros:Hello", 1)
    assert element.getProperty(":Hello").value == 1
    assert element.hasRelation("-1", "skiros:pred", "x")
    assert ends(element.getRelations(pred=":pred")) == [("-1", "pred", "x")]


@rule("element", "Names are completed when the element is written to the world model")
def test_names_are_completed_in_the_world_model(bench):
    element = Element("Product", "bolt")
    element.setProperty("Weight", 2.0)
    element.addRelation("skiros:Scene-0", "contain", "-1")
    bench.wmi.add_element(element)
    read = bench.wmi.get_element(element.id)
    assert (read.type, read.hasProperty("skiros:Weight", 2.0)) == ("skiros:Product", True)
    assert "skiros:Weight" in read.available_properties
    assert ("skiros:Scene-0", "skiros:contain", "-1") in ends(read.getRelations())
    read.setProperty("Weight", 3.0)
    read.setProperty("ContainerState", "Full")
    read._properties["Size"] = read.getProperty("Weight")
    bench.wmi.update_element(read)
    now = bench.wmi.get_element(element.id)
    assert now.getProperty("skiros:Weight").values == [3.0]
    assert now.getProperty("skiros:ContainerState").value == "Full"
    assert "skiros:Size" in now.available_properties
    assert [e.id for e in bench.wmi.resolve_elements(now.__class__("Product"))].count(element.id) == 1


# -- relations -----------------------------------------------------------------------------------------------------


@rule("element", "A relation is a dict `src`, `type`, `dst`, `state`, `abstract`; an equal one is added once")
def test_add_relation_once(box):
    before = len(box.getRelations())
    assert box.addRelation("-1", "skiros:contain", "skiros:Part-1") is None
    assert len(box.getRelations()) == before
    box.addRelation("-1", "skiros:contain", "skiros:Part-1", False)
    assert box.getRelations()[-1] == {
        "src": "-1", "type": "skiros:contain", "dst": "skiros:Part-1", "state": False, "abstract": False,
    }  # fmt: skip


@rule("element", "`addRelation` with an `Element` keeps it in `_local_relations` as `{'src': '-1', 'type', 'dst'}`")
def test_element_as_object_is_a_local_relation(box):
    part = Element("skiros:Part")
    before = list(box._relations)
    box.addRelation("anything", "skiros:contain", part)
    assert box._local_relations == [{"src": "-1", "type": "skiros:contain", "dst": part}]
    assert box._relations == before


@rule("element", "`addRelation` between anything else than texts is a `ValueError`")
@pytest.mark.parametrize(("subj", "obj"), [("-1", 5), (None, "x"), ("-1", None)])
def test_ends_are_texts(box, subj, obj):
    with pytest.raises(ValueError, match="skiros:at"):
        box.addRelation(subj, "skiros:at", obj)


@rule("element", '`getRelations`: `""` matches any side; `""`, `[]` and `[""]` match any predicate')
def test_get_relations(box):
    assert len(box.getRelations()) == len(box.getRelations("", "", "")) == len(box.getRelations(pred=[""])) == 3
    assert ends(box.getRelations(obj="-1")) == [("skiros:Scene-0", "skiros:contain", "-1")]
    box.addRelation("-1", "skiros:at", "skiros:Location-1")
    assert len(box.getRelations("-1", ["skiros:at", "skiros:contain"])) == 3
    assert box.getRelation("-1", "skiros:at")["dst"] == "skiros:Location-1"
    assert box.getRelation("-1", "skiros:hasA") is None


@rule("element", "The dicts of `getRelations` are the element's own: what is changed in them is written with it")
def test_relation_dicts_are_live(bench):
    product = bench.wmi.get_element(bench.product.id)
    product.getRelation("", "skiros:contain", "-1")["src"] = bench.other_tray.id
    bench.wmi.update_element(product)
    assert bench.wmi.get_relations(bench.other_tray.id, "skiros:contain", product.id)
    assert not bench.wmi.get_relations(bench.tray.id, "skiros:contain", product.id)


@rule("element", "What is changed on an element is not changed in the world model before it is written")
def test_changes_stay_local(bench):
    product = bench.wmi.get_element(bench.product.id)
    product.getRelations()[0]["dst"] = "skiros:Nowhere-1"
    product._relations.append({"src": "-1", "type": "skiros:at", "dst": "x"})
    product._properties.clear()
    again = bench.wmi.get_element(bench.product.id)
    assert "skiros:Nowhere-1" not in [r["dst"] for r in again.getRelations()]
    assert not again.getRelations("-1", "skiros:at")
    assert again.available_properties == bench.product.available_properties


@rule(
    "element", '`setRelation` replaces the relations with that predicate whose side is `"-1"`; without one, all of it'
)
@pytest.mark.parametrize(
    ("call", "left"),
    [
        (("-1", "skiros:contain", "x"), [("skiros:Scene-0", "skiros:contain", "-1"), ("-1", "skiros:contain", "x")]),
        (("x", "skiros:contain", "-1"),
         [("-1", "skiros:contain", "skiros:Part-1"), ("-1", "skiros:contain", "skiros:Part-2"),
          ("x", "skiros:contain", "-1")]),
        (("x", "skiros:contain", "y"), [("x", "skiros:contain", "y")]),
    ],
)  # fmt: skip
def test_set_relation(box, call, left):
    box.setRelation(*call)
    assert ends(box.getRelations()) == left


@rule("element", '`hasRelation` is exact; `"-1"` or `""` as subject (else object) stands for the element\'s id')
def test_has_relation(box):
    assert box.hasRelation("-1", "skiros:contain", "skiros:Part-1")
    assert not box.hasRelation("-1", "skiros:contain", "skiros:Part-2")
    assert box.hasRelation("-1", "skiros:contain", "skiros:Part-2", abstract=True)
    assert not box.hasRelation("-1", "skiros:contain", "skiros:Part-1", False)
    assert not box.hasRelation("-1", "", "skiros:Part-1")
    box._relations = [
        {"src": box.id, "type": "skiros:at", "dst": "x", "state": True, "abstract": False},
        {"src": "y", "type": "skiros:at", "dst": box.id, "state": True, "abstract": False},
    ]
    assert box.hasRelation("-1", "skiros:at", "x") and box.hasRelation("", "skiros:at", "x")
    assert box.hasRelation("y", "skiros:at", "-1") and box.hasRelation("y", "skiros:at", "")


@rule("element", "Missing relations are removed without an error; `removeRelation2` is exact and logs a missing one")
def test_remove_relations(box, caplog):
    missing = {"src": "a", "type": "b", "dst": "c", "state": True, "abstract": False}
    box.removeRelation(missing)
    box.removeRelations([missing, *box.getRelations(obj="-1")])
    assert len(box.getRelations()) == 2
    box.removeRelation2("", "skiros:contain", "skiros:Part-1")
    assert len(box.getRelations()) == 2
    assert "no relation" in caplog.text
    box.removeRelation2("-1", "skiros:contain", "skiros:Part-1")
    assert [r["dst"] for r in box.getRelations()] == ["skiros:Part-2"]


@rule(
    "element",
    "`_relations`, `_properties`, `_local_relations`, `_id`, `_label`, `_type` are read, changed and assigned",
)
def test_private_attributes_are_read_and_assigned(bench):
    element = bench.wmi.get_element(bench.product.id)
    element.setProperty("skiros:Weight", 1.0)
    element._relations = [r for r in element._relations if r["dst"] != "-1"]
    element._relations.append({"src": bench.other_tray.id, "type": "skiros:contain", "dst": "-1"})
    element._label = "renamed"
    element._properties = {k: p for k, p in element._properties.items() if k == "skiros:Weight"}
    bench.wmi.update_element(element)
    read = bench.wmi.get_element(bench.product.id)
    assert read.label == "renamed"
    assert read.available_properties == ["skiros:Weight"]
    assert ends(read.getRelations("", "skiros:contain", "-1")) == [(bench.other_tray.id, "skiros:contain", "-1")]
    element._id, element._type, element._local_relations = "", "skiros:Part", []
    assert element.isAbstract() and element.type == "skiros:Part"


# -- properties ----------------------------------------------------------------------------------------------------


@rule("element", "`getProperty` of a missing key is a `KeyError`; `removeProperty` of one is silent")
def test_missing_properties(box):
    with pytest.raises(KeyError, match="Weight"):
        box.getProperty("Weight")
    box.removeProperty("Weight")


@rule("element", "`setProperty` with a datatype makes a property of that type; an unknown datatype is logged")
def test_set_property_with_a_datatype(box, caplog):
    box.setProperty("skiros:Weight", 2, "xsd:float")
    assert box.getProperty("skiros:Weight").dataType() is float
    box.setProperty("skiros:Weight", "heavy", "xsd:string")
    assert box.getProperty("skiros:Weight").values == ["heavy"]
    box.setProperty("skiros:Colour", "red", "xsd:colour")
    assert box.getProperty("skiros:Colour").value == "red"
    assert "xsd:colour" in caplog.text


@rule("element", "`setProperty(..., force_convertion=True)` converts to the property's type, else `ValueError`")
def test_set_property_with_conversion(box):
    box.setProperty("skiros:Weight", 1.5)
    box.setProperty("skiros:Weight", "2.5", force_convertion=True)
    assert box.getProperty("skiros:Weight").values == [2.5]
    with pytest.raises(ValueError, match="heavy"):
        box.setProperty("skiros:Weight", "heavy", force_convertion=True)
    assert box.getProperty("skiros:Weight").values == [2.5]


@rule("element", "`setProperty` of another type than the property's is logged and changes nothing")
def test_set_property_of_another_type(box, caplog):
    box.setProperty("skiros:Weight", 1.5)
    box.setProperty("skiros:Weight", "2.5")
    assert box.getProperty("skiros:Weight").values == [1.5]
    assert "skiros:Weight" in caplog.text


@rule("element", "`setProperty(key, type)` makes an empty property and leaves an existing one; `None` unsets one")
def test_set_property_to_a_type_or_none(box):
    box.setProperty("skiros:Weight", float)
    assert (box.getProperty("skiros:Weight").values, box.getProperty("skiros:Weight").dataType()) == ([], float)
    box.setProperty("skiros:Weight", 1.5)
    box.setProperty("skiros:Weight", float)
    box.setProperty("skiros:Weight", str)
    assert box.getProperty("skiros:Weight").values == [1.5]
    box.setProperty("skiros:Weight", None)
    assert box.getProperty("skiros:Weight").values == []
    box.setProperty("skiros:New", None)
    assert box.hasProperty("skiros:New") and box.getProperty("skiros:New").value is None


# -- reasoners -----------------------------------------------------------------------------------------------------


class Painter(DiscreteReasoner):
    def onAddProperties(self, element):
        if not element.hasProperty("skiros:Paint"):
            element.setProperty("skiros:Paint", "white")

    def onRemoveProperties(self, element):
        element.removeProperty("skiros:Paint")

    def hasData(self, element, get_code):
        return element.hasProperty("skiros:Paint", not_none=True)

    def getData(self, element, get_code):
        return element.getProperty("skiros:Paint").value

    def setData(self, element, data, set_code):
        element.setProperty("skiros:Paint", data)
        return "painted"

    def getAssociatedProperties(self):
        return [":Colour"]

    def getAssociatedData(self):
        return ["skiros:Paint"]

    def getAssociatedRelations(self):
        return []


@pytest.fixture
def painter(monkeypatch):
    monkeypatch.setattr(reasoners, "_by_name", {})
    monkeypatch.setattr(reasoners, "_owners", {})
    monkeypatch.setattr(reasoners, "_cache", {})
    reasoners.add(Painter())


REASONER = "skiros:DiscreteReasoner"


@rule("element", "Naming a reasoner in `skiros:DiscreteReasoner` adds its properties; no longer naming it removes them")
@pytest.mark.parametrize("take_back", [
    lambda e: e.setProperty(REASONER, []),
    lambda e: e.setProperty(REASONER, None),
    lambda e: e.removeProperty(REASONER),
])  # fmt: skip
def test_naming_a_reasoner(box, painter, take_back):
    box.setProperty(REASONER, "Painter")
    assert box.getProperty("skiros:Paint").value == "white"
    box.setProperty("skiros:Paint", "red")
    box.setProperty(REASONER, ["Painter"])
    assert box.getProperty("skiros:Paint").value == "red"
    take_back(box)
    assert not box.hasProperty("skiros:Paint")


@rule("element", "Naming an unknown reasoner is logged, and the name stays")
def test_naming_an_unknown_reasoner(box, painter, caplog):
    box.setProperty(REASONER, ["Painter", "Nobody"])
    assert box.getProperty(REASONER).values == ["Painter", "Nobody"]
    assert "Nobody" in caplog.text
    assert box.hasProperty("skiros:Paint")


@rule("element", "`setReasoner(name)` and `unsetReasoner(name)` add and remove the properties; unknown: `KeyError`")
def test_set_reasoner(box, painter):
    box.setReasoner("Painter")
    assert box.hasProperty(REASONER, "Painter") and box.hasProperty("skiros:Paint")
    box.unsetReasoner("Painter")
    assert not box.hasProperty(REASONER, "Painter") and not box.hasProperty("skiros:Paint")
    for call in (box.setReasoner, box.unsetReasoner):
        with pytest.raises(KeyError, match="Nobody"):
            call("Nobody")


@rule("element", "`setData(code, data)` adds the reasoner's properties and returns what its `setData` returns")
def test_set_data(box, painter):
    assert box.setData(":Colour", "blue") == "painted"
    assert box.hasProperty(REASONER, "Painter")
    assert box.getData(":Colour") == "blue" and box.hasData(":Colour")


@rule("element", "`getAssociatedReasonerId` finds the owner of a property, not of a code")
def test_associated_reasoner(box, painter):
    assert box.getAssociatedReasonerId("skiros:Paint") == "Painter"
    assert box.getAssociatedReasonerId(":Colour") == ""


# -- others --------------------------------------------------------------------------------------------------------


@rule("element", "`printState()` is `<id or type>-<label>`; verbose adds a line per property and relation")
def test_print_state(box):
    box.setProperty("skiros:Weight", 1.5)
    box.setProperty("skiros:WeightLimit", 2.5)
    assert box.printState() == "skiros:LargeBox-7-box"
    assert Element("skiros:Part", "p").printState() == "skiros:Part-p"
    lines = box.printState(verbose=True).splitlines()
    assert lines[1:3] == [p.printState() for p in box.properties]
    assert lines[3:] == [str(r) for r in box.getRelations()]
    named = box.printState(verbose=True, filter="skiros:Weight")
    assert "skiros:Weight:" in named and "skiros:WeightLimit" not in named


@rule("element", '`isInstance`: a label `""` or `"Unknown"` matches any; class, values and relations have to fit')
def test_is_instance(box):
    for label, fits in (("", True), ("Unknown", True), ("box", True), ("other", False)):
        assert box.isInstance(Element("LargeBox", label), None) is fits
    wanted = Element("skiros:LargeBox")
    wanted.addRelation("-1", "contain", "skiros:Part-1")
    assert box.isInstance(wanted, None)
    wanted.setProperty("Weight", 2.0)
    assert not box.isInstance(wanted, None)
    box.setProperty("skiros:Weight", 2.0)
    assert box.isInstance(wanted, None)


@rule("element", "Elements compare by identity; copies are independent")
def test_identity(box):
    other = Element(box.type, box.label, box.id)
    assert box != other and box in [other, box] and len({box, other}) == 2
    for twin in (copy.copy(box), copy.deepcopy(box)):
        twin.setProperty("skiros:Weight", 1.0)
        twin.getRelations()[0]["dst"] = "x"
        assert not box.hasProperty("skiros:Weight") and box.getRelations()[0]["dst"] != "x"


@rule("element", "`getLastUpdate()` is a `datetime`")
def test_last_update(bench):
    now = datetime.datetime.now()
    assert isinstance(Element("skiros:Part").getLastUpdate(), datetime.datetime)
    assert abs(bench.wmi.get_element(bench.product.id).getLastUpdate() - now) < datetime.timedelta(minutes=5)
