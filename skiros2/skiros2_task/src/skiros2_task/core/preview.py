"""Previews a plan: simulates it on a copy of the world model.

The simulation evaluates and applies the same condition classes as the skill managers, read from the skills' elements,
so it also validates the planning task.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field

from skiros2_common.core.conditions import ConditionBase, condition_from
from skiros2_common.core.json_data import JsonData
from skiros2_common.core.operations import Change
from skiros2_common.core.params import Param, ParamHandler, ParamTypes
from skiros2_common.core.wording import verb, visible, words
from skiros2_common.core.world_element import Element
from skiros2_common.core.world_model_port import WorldModelPort
from skiros2_task.core.actions import ROBOT_KEY
from skiros2_task.core.conditions import condition_of
from skiros2_task.core.formula import Atom, Formula, Kind, fold
from skiros2_task.core.goal_sentence import NameOf
from skiros2_task.core.plan import Plan, SkillCall, Step
from skiros2_task.core.skills import Skill, SkillCondition, SkillParameter
from skiros2_task.core.task import PlanningTask, PlanStep

#: The action of a change of the world model that removes elements.
_REMOVE = "remove"

_PARAMETERS = ("Subject", "Object")


@dataclass
class FactChange:
    """A fact that a step adds (`state` true) or deletes.

    :param element: its id.
    :param name: the relation or property; "" for the element as a whole.
    :param value: the id of the related element, or the value.
    :param is_relation: whether it is a relation.
    """

    element: str
    name: str
    value: str
    state: bool
    is_relation: bool = False

    def line(self, labels: Mapping[str, str]) -> str:
        """Returns the text.

        :param labels: of the elements, by id.
        """
        parts = (_named(self.element, labels), self.name, _named(self.value, labels))
        return visible(f"{'+' if self.state else '-'} {' '.join(part for part in parts if part)}")


def change_sentences(changes: Iterable[FactChange], name_of: NameOf) -> Iterator[str]:
    """Yields changes as sentences: "Tray B contains Product A", "state of Tray B is Full (was Empty)"."""
    values: dict[tuple[str, str], dict[bool, list[str]]] = {}
    for change in changes:
        if not change.name:
            yield f"{name_of(change.element)} {'is created' if change.state else 'is removed'}"
        elif change.is_relation:
            yield f"{name_of(change.element)} {verb(change.name, change.state, has_ended=True)} {name_of(change.value)}"
        else:
            values.setdefault((change.element, change.name), {True: [], False: []})[change.state].append(change.value)
    for (eid, key), of in values.items():
        now, before = ", ".join(of[True]), ", ".join(of[False])
        was = f" (was {before})" if now and before else ""
        yield f"{words(key)} of {name_of(eid)} is {now or f'no longer {before}'}{was}"


@dataclass
class PreviewStep:
    """A simulated step.

    :param skill: type and label.
    :param arguments: the ids of its elements, by key; of an element that it creates, the class.
    :param unsatisfied: the conditions that do not hold when it starts, as text.
    :param assumed: choices that the skill's description leaves open, as text.
    """

    number: int
    skill: str
    manager: str
    arguments: dict[str, str] = field(default_factory=dict)
    unsatisfied: list[str] = field(default_factory=list)
    assumed: list[str] = field(default_factory=list)
    changes: list[FactChange] = field(default_factory=list)

    def lines(self, labels: Mapping[str, str]) -> Iterator[str]:
        yield f"{self.number}. {self.skill} by {self.manager}"
        yield f"     with {', '.join(f'{key}={_named(value, labels)}' for key, value in self.arguments.items())}"
        for text in self.unsatisfied:
            yield f"     does not hold: {text}"
        for change in self.changes:
            yield f"   {change.line(labels)}"
        for text in self.assumed:
            yield f"     assumed: {text}"


@dataclass
class Preview(JsonData):
    """A simulated plan.

    :param reached: whether the goal holds at the end.
    :param labels: of the elements in the steps, created and removed ones included, by id.
    """

    steps: list[PreviewStep]
    reached: bool
    labels: dict[str, str] = field(default_factory=dict)
    _data_name = "preview"

    @property
    def works(self) -> bool:
        """Whether the conditions of all steps hold, and the goal at the end."""
        return self.reached and not any(step.unsatisfied for step in self.steps)

    def __str__(self) -> str:
        return "\n".join(self.lines())

    def lines(self) -> Iterator[str]:
        """Yields the text."""
        for step in self.steps:
            yield from step.lines(self.labels)
        yield f"the goal {'holds' if self.reached else 'does not hold'} at the end"


def preview(copy: WorldModelPort, plan: Plan) -> Preview:
    """Simulates a plan on a copy of the scene. The copy is changed.

    :param copy: of the world that the plan was made for, such as a `PreviewCopy`.
    """
    simulation = _Simulation(copy, plan.task)
    simulated = [simulation.run(step, planned) for step, planned in zip(plan.steps, plan.order.steps, strict=True)]
    return Preview(simulated, simulation.holds(plan.task.goal), simulation.labels)


def preview_skill(copy: WorldModelPort, skill: Skill, manager: str, elements: Mapping[str, str]) -> Preview:
    """Simulates the start of a skill on a copy of the scene. The copy is changed.

    :param manager: the node name of the robot's skill manager.
    :param elements: ids by the key of the parameter.
    """
    simulation = _Steps(copy)
    found = {key: element for key, eid in elements.items() if (element := copy.find_element(eid)) is not None}
    return Preview([simulation.apply(PreviewStep(1, skill.name, manager), skill, found)], True, simulation.labels)


class _Steps:
    """Applies the effects of skills to a copy of the scene, one after the other."""

    def __init__(self, copy: WorldModelPort) -> None:
        self._copy = copy
        self._now = {e.id: e for e in copy.resolve_elements(Element())}
        self._created: dict[str, str] = {}  # the ids of created elements, by their names in the task
        self.labels: dict[str, str] = {}  # of the elements of the simulated steps, by id

    def apply(
        self, result: PreviewStep, skill: Skill, elements: Mapping[str, Element], named: Mapping[str, str] | None = None
    ) -> PreviewStep:
        """Simulates a step. Returns `result` with all fields.

        :param named: the names of the elements in the planning task.
        """
        result.arguments = {key: e.id or f"a new {e.type}" for key, e in elements.items()}
        self._note_labels(elements.values())
        params = ParamHandler({p.key: _param(p, elements.get(p.key), self._copy) for p in skill.parameters})
        result.unsatisfied = [
            f"[{condition.label}] {condition.found(params, self._copy)}"
            for condition in self._preconditions(skill)
            if not condition.evaluate(params, self._copy)
        ]
        before: dict[str, Element | None] = {}  # changed elements before the step

        def record(change: Change) -> None:
            for element in change.elements:
                before.setdefault(element.id, self._now.get(element.id))
                if change.action == _REMOVE:
                    self._now.pop(element.id, None)
                else:
                    self._now[element.id] = element

        self._copy.add_listener(record)
        # Deletes come first: a fact that is made both true and false is true.
        for effect in sorted(skill.post, key=lambda c: c.state):
            result.assumed += self._apply(effect, params)
        self._copy.remove_listener(record)
        for key, name in (named or {}).items():
            if not elements[key].id and params.hasParam(key) and params.is_bound(key):
                self._created[name] = params.getParamValue(key).id
        for eid, old in before.items():
            result.changes += _differences(eid, old, self._now.get(eid))
        involved = {name for change in result.changes for name in (change.element, change.value)}
        self._note_labels(e for e in before.values() if e is not None)
        self._note_labels(self._now[eid] for eid in involved & self._now.keys())
        return result

    def _note_labels(self, elements: Iterable[Element]) -> None:
        self.labels.update((e.id, e.label) for e in elements if e.id and e.label)

    def _preconditions(self, skill: Skill) -> list[ConditionBase]:
        """Returns the conditions that must hold when a skill starts."""
        holds = [c for c in skill.hold if not any(c.contradicts(pre) for pre in skill.pre)]
        conditions = (condition_from(condition) for condition in dict.fromkeys((*skill.pre, *holds)))
        return [condition for condition in conditions if condition is not None]

    def _apply(self, effect: SkillCondition, params: ParamHandler) -> list[str]:
        """Applies an effect. Returns messages about chosen values and effects without a value."""
        condition = condition_from(effect)
        if condition is None:
            return [f"{effect.kind} {effect.label!r} has no effect: planning cannot read it"]
        for key in condition.getKeys():
            if params.is_bound(key):  # the current element
                params.specify(key, self._copy.get_element(params.getParamValue(key).id))
        if condition.setTrue(params, self._copy):
            return []
        value = condition.example_value(self._copy)
        if value is None or not params.is_bound(effect.subject):
            return [f"[{effect.label}] is unchanged"]
        element = self._copy.get_element(params.getParamValue(effect.subject).id)
        element.setProperty(effect.name, value)
        self._copy.update_element_properties(element)
        return [f"{_name(element)} {effect.name} {value}, an example for: {condition.expected()}"]


class _Simulation(_Steps):
    """Simulates the steps of a plan."""

    def __init__(self, copy: WorldModelPort, task: PlanningTask) -> None:
        super().__init__(copy)
        self._task = task

    def run(self, step: Step, planned: PlanStep) -> PreviewStep:
        """Simulates a step.

        :param planned: the same step in the planning task.
        """
        variables = self._task.action(planned.action).variables
        named = {v.key or ROBOT_KEY: name for v, name in zip(variables, planned.arguments, strict=True)}
        result = PreviewStep(step.number, step.skill.name, step.call.manager)
        return self.apply(result, step.skill, self._elements(named, step.call, result), named)

    def holds(self, formula: Formula) -> bool:
        """Whether a ground formula without quantifiers holds now, by the conditions that managers evaluate."""
        return fold(formula, lambda atom, state: self._is_true(atom) == state, all, any)

    def _is_true(self, atom: Atom) -> bool:
        if atom.predicate.kind is Kind.CAN:
            return atom in self._task.init
        found = [self._copy.find_element(self._created.get(term, term)) for term in atom.terms]
        params = ParamHandler()
        for key, element in zip(_PARAMETERS, found, strict=False):
            if element is None:
                return False
            params.addParam(key, element, ParamTypes.Required)
        condition = condition_from(condition_of(atom.predicate, *_PARAMETERS))
        return condition is not None and bool(condition.evaluate(params, self._copy))

    def _elements(self, named: Mapping[str, str], call: SkillCall, result: PreviewStep) -> dict[str, Element]:
        """Returns the current elements of a step by parameter; abstract elements for those to create."""
        given = dict(call.arguments)
        found = {}
        for key, name in named.items():
            element = self._copy.find_element(self._created.get(name, name))
            if element is None and key in given:
                # A template that stands for itself: the skill infers an instance when it starts.
                element = self._copy.instanciate(given[key].label)
                self._created[name] = element.id
                result.assumed.append(f"an instance of {given[key].label} is found, here {element.id}")
            found[key] = element if element is not None else Element(self._task.objects[name])
        return found


def _param(parameter: SkillParameter, element: Element | None, copy: WorldModelPort) -> Param:
    kind = parameter.kind
    if parameter.element_class is None:
        return Param(parameter.key, "", str, kind)  # conditions that planning can read do not depend on its value
    param = Param(parameter.key, "", Element(parameter.element_class), kind)
    given = copy.find_element(parameter.fixed) if parameter.fixed else element
    if given is not None and not given.isAbstract():
        param.assign(given)
    return param


def _differences(eid: str, old: Element | None, new: Element | None) -> Iterator[FactChange]:
    """Yields the changes of an element."""
    if old is None or new is None:
        if old is not new:
            yield FactChange(eid, "", "", new is not None)
        if new is None:
            return
    then, now = _facts(old), _facts(new)
    for state, facts, others in ((False, then, now), (True, now, then)):
        for name, value, is_relation in facts:
            if (name, value, is_relation) not in others:
                yield FactChange(eid, name, value, state, is_relation)


def _facts(element: Element | None) -> dict[tuple[str, str, bool], None]:
    """Returns the properties and outgoing relations of an element; whether it is a relation is the last part."""
    if element is None:
        return {}
    facts = {(prop.key, str(value), False): None for prop in element.properties for value in prop.values}
    return {**facts, **{(r["type"], r["dst"], True): None for r in element.getRelations("-1")}}


def _name(element: Element) -> str:
    return _named(element.id, {element.id: element.label})


def _named(eid: str, labels: Mapping[str, str]) -> str:
    """Returns an id with the label; any other text as it is."""
    return f'{eid} "{labels[eid]}"' if labels.get(eid) else eid
