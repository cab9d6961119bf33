"""The codes of findings: the meaning of each, its consequence, and an example with its correction."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Meaning:
    """The explanation of a code.

    :param text: what is wrong, in one sentence.
    :param advice: what to do.
    :param wrong, right: an example of Python code, and the same corrected; "" when there is none.
    """

    text: str
    advice: str
    wrong: str = ""
    right: str = ""


_DECLARE = "Correct the name, or declare it in an ontology of the workspace; --workspace names its folder."
_CONDITION = 'self.addPreCondition(self.getRelationCond("At", "skiros:at", "Robot", "{}", True))'
_CHILD = 'self.skill("Drive", "", remap={{"{}": "{}"}})'

#: By code.
MEANINGS: dict[str, Meaning] = {
    "contradiction": Meaning(
        "Two conditions of a skill cannot both hold.",
        "Remove one, or correct its desired state. A state that a skill changes is a pre- and a post-condition.",
        'self.addHoldCondition(self.getPropCond("Open", "skiros:Open", "Gripper", "=", True, True))\n'
        'self.addHoldCondition(self.getPropCond("Closed", "skiros:Open", "Gripper", "=", False, True))',
    ),
    "contradicts-description": Meaning(
        "An implementation lacks a parameter of its description, or takes values of another type. Callers and the "
        "planner choose by the description, and the start of this implementation differs from it.",
        "Declare the parameter as in the description; an implementation may narrow an element's class.",
    ),
    "domain-range": Meaning(
        "A relation or property is used with an element of another class than its rdfs:domain or rdfs:range states.",
        "Correct the relation or the element's class, or widen the statement in the ontology.",
    ),
    "limits": Meaning(
        "The limits of a parameter do not fit its type, its default or each other, or a specified value is outside.",
        "Correct the limits or the value.",
        'self.addParam("Speed", 3.0, ParamTypes.Optional, maximum=2.0)',
        'self.addParam("Speed", 1.0, ParamTypes.Optional, maximum=2.0)',
    ),
    "needs-ros": Meaning(
        "A module uses ROS, which is not installed here: its skills are skipped, and were not checked (a note).",
        "Check the library where ROS is installed.",
    ),
    "never-set": Meaning(
        "A child requires a value without a default, and nothing in the tree sets it: its start fails.",
        "Specify the value, remap it to a key that a sibling or the compound sets, or give the parameter a default.",
        'self.skill("Push", "")',
        'self.skill("Push", "", specify={"Force": 5.0})',
    ),
    "not-checked": Meaning(
        "The tree of a compound depends on values that are known at its start only, so it was not checked (a note).",
        "Test the compound with values, see docs/skills.md.",
    ),
    "not-described": Meaning(
        "The constructor or createDescription of a skill raises an error: the skill is skipped.",
        "Correct the error at this line. It runs without a robot: no connections, files or calls of ROS there.",
    ),
    "not-imported": Meaning(
        "A module of the library cannot be imported: all of its skills are missing.",
        "Correct the error at this line, or install the module that it imports.",
    ),
    "recursion": Meaning(
        "A compound is a part of itself, also through others, without an alternative: its tree has no end.",
        "Name another implementation for the inner one, or take it out.",
    ),
    "scene": Meaning(
        "A scene deviates from the ontologies or the shapes, in the way that the text says.",
        "Correct the scene; rosrun skiros2_world_model validate_scene shows all findings of a file in a table.",
    ),
    "slow-expand": Meaning(
        "expand takes more than half a second. It runs between ticks and delays all tasks of the robot.",
        "Move computations and calls into a primitive of the tree.",
    ),
    "syntax": Meaning(
        "An ontology or scene file does not parse: it is skipped, and the world model starts without it.",
        "Correct the file at this line and column; the mistake may be at the end of the statement before.",
    ),
    "unknown-class": Meaning(
        "No ontology declares the class of a parameter, condition or element: no element will match.", _DECLARE,
        'Element("skiros:Prodcut")', 'Element("skiros:Product")',
    ),
    "unknown-key": Meaning(
        "A condition refers to a parameter that the skill does not have: it fails where it is checked.",
        "Correct the key, or add the parameter.",
        _CONDITION.format("Dor"), _CONDITION.format("Door"),
    ),
    "unknown-property": Meaning(
        "No ontology declares the property of a condition or element: no skill will find it.", _DECLARE,
    ),
    "unknown-relation": Meaning(
        "No ontology declares the relation of a condition, and no reasoner computes it: it will not hold.", _DECLARE,
    ),
    "unknown-remap": Meaning(
        "A child has no parameter of the remapped name, and no skill under it has: the remap has no effect.",
        "Correct the name. The first name is the child's, the second one the key that the tree shares.",
        _CHILD.format("TargetLoction", "Shelf"), _CHILD.format("TargetLocation", "Shelf"),
    ),
    "unknown-skill": Meaning(
        "No library has a skill of that type, or no implementation of that name.",
        "Correct the type, or name its package: in libraries_list of the launch file, and with --uses here.",
        'self.skill("Driv", "")', 'self.skill("Drive", "")',
    ),
    "unknown-specify": Meaning(
        "A child has no parameter of the specified name: the value is ignored.",
        "Correct the name.",
        'self.skill("Wait", "wait", specify={"Duraton": 1.0})', 'self.skill("Wait", "wait", specify={"Duration": 1.0})',
    ),
    "unknown-target": Meaning(
        "A remap leads to a key that no ancestor or sibling has: the child gets no value by it.",
        "Correct the second name, or add a parameter of that name to the compound.",
        _CHILD.format("TargetLocation", "Shlef"), _CHILD.format("TargetLocation", "Shelf"),
    ),
    "unused-prefix": Meaning(
        "A Turtle file declares a prefix that it does not use.",
        "Take the declaration out, or correct the prefix of the names that were meant.",
    ),
    "wrong-literal": Meaning(
        "A literal is not of its datatype or of the property's range, or stands where an element or class is expected.",
        "Correct the value or its datatype.",
    ),
    "wrong-stage": Meaning(
        "A condition of this kind cannot be checked at this stage: a start fails.",
        "Add it at the stage that the text names; conditions on signals are hold-conditions.",
    ),
    "wrong-type": Meaning(
        "A remap, a specified value or a condition does not match the type of a parameter.",
        "Give a value of the parameter's type, or remap to a key of the same type.",
        'self.skill("Wait", "wait", specify={"Duration": "long"})',
        'self.skill("Wait", "wait", specify={"Duration": 1.0})',
    ),
}  # fmt: skip
