"""The base class of conditions: a fact about parameters and the world model, and whether it has to hold."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from itertools import islice
from typing import TYPE_CHECKING, Any, ClassVar, Self, TypeGuard

from skiros2_common.core.condition_record import ConditionRecord, Cost
from skiros2_common.core.errors import UnknownName, WrongType
from skiros2_common.core.explanation import MAX_EXAMPLES, Change, Finding, NearMatch
from skiros2_common.core.failure_kind import FailureKind
from skiros2_common.core.names import ANY_TYPE, id_order
from skiros2_common.core.params import ParamHandler
from skiros2_common.core.source_location import SourceLocation
from skiros2_common.core.world_element import Element

if TYPE_CHECKING:
    from skiros2_common.core.signals import SignalBounds, SignalSource
    from skiros2_common.core.world_model_port import WorldModelPort

#: The methods that state how a condition is evaluated, and those that say the same in a faster way.
_EVALUATION = ("__init__", "evaluate", "holds", "holds_for", "satisfied_for_inference")
_SHORTCUTS = (
    "element_ids", "candidate_ids", "indexed_value", "satisfied_by", "from_record", "record_fields", "planned_as"
)  # fmt: skip


class _OfParameters:
    """Reads the elements in the parameters of a condition, for evaluation and for explanations."""

    #: Of the failure of a skill for which the condition does not hold.
    failure_kind: FailureKind = FailureKind.RETRYABLE

    def __init__(self, clabel: str) -> None:
        self._label = clabel
        self._checked: dict[str, Any] = {}  # key -> its value at the last evaluation

    def _remember(self, key: str, ph: ParamHandler) -> None:
        param = ph._params.get(key)
        self._checked[key] = param.current[0] if param is not None and param.current else None

    def _name(self, key: str) -> str:
        value = self._checked.get(key, key)
        if isinstance(value, Element):
            return repr(value) if value.id else f"any {value!r}".rstrip("-")
        return f"{key} (unset)" if value is None else str(value)

    def _param_value(self, key: str, ph: ParamHandler) -> Any:
        """The parameter's value.

        :raises UnknownName: the skill has no such parameter.
        """
        param = ph._params.get(key)
        if param is None:
            raise UnknownName(f"condition {self._label!r} uses {key!r}; the skill has: {', '.join(ph.keys())}")
        return param.current[0] if param.current else None

    def _element(self, key: str, ph: ParamHandler, wmi: WorldModelPort) -> Element | None:
        """The element in a parameter; None if the parameter is unset or the world model no longer has the element.

        An element with unwritten changes is returned as it is, any other in the world model's current state.

        :raises UnknownName: the skill has no such parameter.
        :raises WrongType: the parameter holds another value.
        """
        value = self._raw_element(key, ph)
        if value is None or value.isAbstract() or not can_find_elements(wmi) or _has_changes(value):
            return value
        return wmi.refreshed(value) if hasattr(wmi, "refreshed") else wmi.find_element(value.id)

    def _raw_element(self, key: str, ph: ParamHandler) -> Element | None:
        """The element in a parameter as it was read; raises the same errors as `_element`."""
        value = self._param_value(key, ph)
        if value is not None and not isinstance(value, Element):
            raise WrongType(f"condition {self._label!r}: parameter {key!r} is {value!r}, expected an element")
        return value

    def _missing_reason(self, key: str, ph: ParamHandler, wmi: WorldModelPort) -> str:
        """Why a parameter holds no element of the scene; "" if it holds one."""
        value = self._param_value(key, ph)
        if value is None:
            return f"parameter {key!r} is unset"
        if not isinstance(value, Element):
            return f"parameter {key!r} is {value!r}"
        if value.isAbstract():
            return f"parameter {key!r} is {self._name(key)}"
        return "" if is_in_scene(value, wmi) else f"{value!r} is not in the scene"

    def _alternatives(
        self,
        key: str,
        ph: ParamHandler,
        wmi: WorldModelPort,
        having: tuple[str, Any] | None = None,
        ids: Iterable[str] | None = None,
    ) -> Iterator[Element]:
        """Other elements of the scene that suit a parameter, ordered by id.

        :param having: a property and a value that the elements must have.
        :param ids: the ids to select from; None: all.
        """
        param = ph.getParamMap().get(key)
        if param is None or not param.is_element:
            return
        wanted = Element(param.element_type)
        if having is not None:
            wanted.setProperty(*having)
        if ids is None:
            found = wmi.resolve_elements(wanted)
        else:
            known = (wmi.find_element(eid) for eid in set(ids))
            found = [e for e in known if e is not None and (wanted.type in ANY_TYPE or e.isInstance(wanted, wmi))]
        current = {value.id for value in param.values}
        for element in sorted(found, key=lambda e: id_order(e.id)):
            if element.id not in current:
                yield element

    def _last_change(self, key: str, name: str, ph: ParamHandler, wmi: WorldModelPort) -> list[Change]:
        """The last change of a property or relation of the element in a parameter, still without number and author."""
        value = self._param_value(key, ph)
        if not isinstance(value, Element) or value.isAbstract():
            return []
        return [Change(value.id, name if is_in_scene(value, wmi) else "")]


class ConditionBase(_OfParameters):
    """A condition on one parameter. Subclasses define the fact (`holds`) and how to apply it as an effect.

    A subclass is a plug-in: it states here what inference, the engine, lint and planning need to know about it. If it
    changes how a condition is evaluated, it inherits no shortcut (see `_SHORTCUTS`), and states again those that apply.

    :param clabel: label for people.
    :param subj: key of the parameter.
    :param desired_state: True: the fact has to hold; False: it must not hold.
    """

    #: The call that added it to a skill; None if unknown.
    source_location: SourceLocation | None = None

    #: Whether only planners use it; a running skill does not check it.
    only_exported = False

    #: Whether the fact may change although the world model and the parameters do not: every tick evaluates it.
    volatile: bool = False

    #: The cost of an evaluation; inference evaluates cheap conditions first.
    cost: Cost = Cost.ELEMENT

    #: Whether it can hold for elements only.
    wants_elements: bool = False

    #: The fields of a `ConditionRecord` that the constructor takes; None: `from_record` creates none.
    record_fields: ClassVar[tuple[str, ...] | None] = None

    #: Its planning predicate: a `Kind` of `formula`, `specified`, `any` (of its parts), `ignored`, or "": none.
    planned_as: str = ""

    #: The loaded classes by name.
    classes: ClassVar[dict[str, type[ConditionBase]]] = {}

    def __init_subclass__(cls) -> None:
        ConditionBase.classes[cls.__name__] = cls
        if not vars(cls).keys().isdisjoint(_EVALUATION):
            for name in _SHORTCUTS:
                if name not in vars(cls):
                    setattr(cls, name, vars(ConditionBase)[name])

    def __init__(self, clabel: str, subj: str, desired_state: bool) -> None:
        super().__init__(clabel)
        self._subject_key = subj
        self._desired_state = desired_state
        self._custom_description = ""
        self._undo: list[Callable[[], object]] = []

    def __eq__(self, other: object) -> bool:
        return self.isEqual(other)

    __hash__ = object.__hash__  # by identity: remaps change equality

    @property
    def label(self) -> str:
        return self._label

    @property
    def _description(self) -> str:
        # The text of `getDescription` without the label; libraries read and assign it.
        return self._custom_description or f"{'' if self._desired_state else 'not '}{self.fact()}"

    @_description.setter
    def _description(self, text: str) -> None:
        self._custom_description = text

    @property
    def desired_state(self) -> bool:
        return self._desired_state

    # -- to override -------------------------------------------------------------------------------------------

    def holds(self, ph: ParamHandler, wmi: WorldModelPort) -> bool:
        """Whether the fact holds, regardless of the desired state."""
        raise NotImplementedError(f"{self.__class__.__name__} has to define holds")

    def fact(self) -> str:
        """The fact as text, with the parameter values of the last evaluation."""
        return f"{self.__class__.__name__}({', '.join(self.getKeys())})"

    @property
    def parts(self) -> Sequence[ConditionBase]:
        """The conditions that it is composed of."""
        return ()

    @property
    def element_keys(self) -> list[str]:
        """The keys of the parameters that have to hold elements; by default all, if it `wants_elements`."""
        return self.getKeys() if self.wants_elements else []

    def faults(self, stage: str) -> list[str]:
        """Describes mistakes of its use, for lint.

        :param stage: `pre`, `hold` or `post`.
        """
        return []

    def watch(
        self, ph: ParamHandler, wmi: WorldModelPort, signals: SignalSource, wake: Callable[[], None]
    ) -> Callable[[], None] | None:
        """Called when a node with this hold-condition has started; for facts outside the world model.

        :param signals: delivers live values.
        :param wake: requests a tick at once; any thread may call it.
        :returns: called when the node has ended; None: there is nothing to end.
        """
        return None

    def signal_bounds(self) -> list[SignalBounds]:
        """Returns the limits that it sets for signals, as last watched. Any thread."""
        return []

    def ontology_names(self) -> list[tuple[str, str]]:
        """The names of the ontology that it refers to, as pairs of kind (relation, property or class) and name."""
        return []

    # -- to override, where there is a faster way than `holds` -------------------------------------------------

    def element_ids(self, ph: ParamHandler) -> set[str] | None:
        """The ids of the elements that the result depends on, with their relations; None: any may change it.

        The parameters themselves and the ontologies are not named. A volatile condition may omit what else changes it.
        """
        return None

    def candidate_ids(self, key: str, ph: ParamHandler, wmi: WorldModelPort) -> set[str] | None:
        """The ids of exactly those elements that satisfy it as the value of a parameter, from an index of the scene.

        The other parameters are bound. None: no index has them.
        """
        return None

    def indexed_value(self) -> tuple[str, Any] | None:
        """A property and the value that it must have, if an index has the elements with that value."""
        return None

    def satisfied_by(self, element: Element) -> bool | None:
        """Whether an element, as passed, satisfies it; None if that depends on more than the element."""
        return None

    @classmethod
    def from_record(cls, record: ConditionRecord) -> Self | None:
        """Creates the condition from its record; None if that is impossible."""
        return cls(*(getattr(record, name) for name in cls.record_fields)) if cls.record_fields is not None else None

    def example_value(self, wmi: WorldModelPort) -> str | bool | float | None:
        """A property value that satisfies it, if it leaves the value open; for previews of plans."""
        return None

    def _signature(self) -> tuple[Any, ...]:
        """The values that identify the fact among conditions of this class."""
        return (self._subject_key,)

    # -- the contract's interface ------------------------------------------------------------------------------

    def evaluate(self, ph: ParamHandler, wmi: WorldModelPort) -> bool:
        """Whether the desired state holds."""
        for key in self.getKeys():
            self._remember(key, ph)
        return self.holds(ph, wmi) == self._desired_state

    def satisfied_for_inference(self, ph: ParamHandler, wmi: WorldModelPort) -> bool:
        """Whether the current values are acceptable to inference; by default the same as `evaluate`."""
        return self.evaluate(ph, wmi)

    def describe(self) -> str:
        """The condition as text, without label: with the elements of its last evaluation, before it with the keys."""
        return self.getDescription().removeprefix(f"[{self._label}] ")  # libraries override only that

    def getDescription(self) -> str:
        """The label, and the condition with the elements of its last evaluation."""
        return f"[{self._label}] {self._description}"

    # -- changes of the world model ----------------------------------------------------------------------------

    def affected_by(self, changed: Collection[str], ph: ParamHandler) -> bool:
        """Whether a change of the world model may change the result.

        :param changed: the ids of the changed elements; empty: the ontologies have changed. See `changed_ids`.
        :param ph: the parameters of the running skill.
        """
        ids = self.element_ids(ph)
        return ids is None or not changed or not ids.isdisjoint(changed)

    def ids_in_parameters(self, ph: ParamHandler) -> set[str] | None:
        """`element_ids` of a condition that reads only the elements in its parameters."""
        ids: set[str] = set()
        for key in self.getKeys():
            param = ph.getParamMap().get(key)
            if param is None or (param.is_element and not param.is_bound()):
                return None  # an unset parameter may stand for any element of a class
            if param.is_element:
                ids.update(element.id for element in param.current)
        return ids

    # -- explanation -------------------------------------------------------------------------------------------

    def explain(self, ph: ParamHandler, wmi: WorldModelPort) -> Finding:
        """Explains why `evaluate` returned False. Searches the scene for near matches.

        :raises SkirosError: as `evaluate`.
        """
        for key in self.getKeys():
            self._remember(key, ph)
        return Finding(
            self.__class__.__name__,
            self._label,
            {key: self._name(key) for key in self.getKeys()},
            self.expected(),
            self.found(ph, wmi) or "it does not hold",
            self._near_matches(ph, wmi),
            self._changes(ph, wmi),
            statement=self.statement(ph, wmi),
        )

    def expected(self) -> str:
        """The wanted state, as text that completes that of `found`."""
        return self.describe()

    def found(self, ph: ParamHandler, wmi: WorldModelPort) -> str:
        """The actual state, when `evaluate` returned False; "" if unknown."""
        return ""

    def statement(self, ph: ParamHandler, wmi: WorldModelPort) -> str:
        """The actual state as a main clause for people; elements are named as in `found`, and replaced by labels."""
        return self.found(ph, wmi) or f"{self.describe()} does not hold"

    def filter_text(self, key: str, ph: ParamHandler) -> str:
        """The condition as text that follows a number of candidates for a parameter: "3 skiros:Part <text>"."""
        return f"for which [{self._label}] holds"

    def found_for(self, key: str, ph: ParamHandler, wmi: WorldModelPort) -> str:
        """Same as `found`, for the element in one parameter."""
        return self.found(ph, wmi)

    def _near_matches(self, ph: ParamHandler, wmi: WorldModelPort) -> list[NearMatch]:
        """Elements that satisfy the condition, at most `MAX_EXAMPLES`."""
        return []

    def _changes(self, ph: ParamHandler, wmi: WorldModelPort) -> list[Change]:
        """The last changes of the facts that it depends on."""
        return []

    def _same_fact(self, other: object) -> TypeGuard[Self]:
        return type(other) is type(self) and self._signature() == other._signature()

    # -- effects and other forms -------------------------------------------------------------------------------

    def remap(self, initial_key: str, target_key: str) -> None:
        """Renames a parameter key."""
        if self._subject_key == initial_key:
            self._subject_key = target_key

    def getParamId(self, key: str) -> str:
        """The id of the element in a parameter at the last evaluation; "" if it had none."""
        value = self._checked.get(key)
        return value.id if isinstance(value, Element) else ""

    def getKeys(self) -> list[str]:
        """The keys of its parameters."""
        return [self._subject_key]

    def isEqual(self, other: object) -> bool:
        """Whether `other` is the same condition, with the same desired state."""
        return self._same_fact(other) and self._desired_state == other._desired_state

    def hasConflict(self, other: object) -> bool:
        """Whether both cannot be satisfied: the same fact with the opposite desired state."""
        return self._same_fact(other) and self._desired_state != other._desired_state

    def setDesiredState(self, ph: ParamHandler) -> bool:
        """Applies the effect to the elements in the parameters. Returns False if that is impossible."""
        return False

    def setTrue(self, ph: ParamHandler, wmi: WorldModelPort) -> bool:
        """Applies the effect to the world model, for simulation. Returns False if that is impossible."""
        return self.evaluate(ph, wmi) or (self._make_true(ph, wmi) and self.evaluate(ph, wmi))

    def _make_true(self, ph: ParamHandler, wmi: WorldModelPort) -> bool:
        """To override: applies the effect and adds its inverse to `_undo`. Returns False if that is impossible."""
        return False

    def revert(self, ph: ParamHandler | None = None, wmi: WorldModelPort | None = None) -> None:
        """Undoes `setTrue`."""
        while self._undo:
            self._undo.pop()()

    def toElement(self) -> Element:
        """The condition as an element of the world model."""
        element = Element(f"skiros:{self.__class__.__name__}", self._label)
        element.setProperty("skiros:hasSubject", self._subject_key)
        element.setProperty("skiros:desiredState", self._desired_state)
        return element

    def copy(self) -> Self:
        """An independent copy."""
        copy = self.__class__.__new__(self.__class__)
        copy.__dict__.update(self.__dict__)
        copy._checked, copy._undo = {}, []
        return copy


def can_find_elements(wmi: WorldModelPort) -> bool:
    """Whether a world model has `find_element`; those of libraries and tests may lack it."""
    return hasattr(type(wmi), "find_element")


def is_in_scene(element: Element, wmi: WorldModelPort) -> bool:
    """Whether an element has an id and exists in the world model, as far as the world model can tell."""
    return bool(element.id) and (not can_find_elements(wmi) or wmi.find_element(element.id) is not None)


def _has_changes(element: Element) -> bool:
    """Whether an element was created or changed in this process."""
    if not element.may_be_changed:
        return False
    changes = element.changes()
    return changes is None or bool(changes)


def near_matches(elements: Iterable[Element], why: str = "") -> list[NearMatch]:
    """The first `MAX_EXAMPLES` elements as near matches."""
    return [NearMatch(repr(element), why) for element in islice(elements, MAX_EXAMPLES)]
