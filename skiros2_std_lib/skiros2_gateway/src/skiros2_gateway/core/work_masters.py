"""Work masters: named goals with typed parameters, in a file or in the world model."""

from __future__ import annotations

import string
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict, Field, FiniteFloat, ValidationError, model_validator

from skiros2_common.core.errors import ConfigurationError, WrongValue
from skiros2_common.core.names import nearest
from skiros2_common.core.world_element import Element
from skiros2_common.core.yaml_text import read_yaml
from skiros2_gateway.core.job import Order
from skiros2_gateway.core.problems import Problem, Rejected, problems_of
from skiros2_gateway.core.values import Value
from skiros2_task.core.goal_text import MAX_GOAL

#: The class of the elements of the scene that define work masters, and the property with the definition.
WORK_MASTER, DEFINITION = "skiros:WorkMaster", "skiros:WorkMasterDefinition"

#: Types of parameters; every other type is a class of the ontology, and the value an element of it.
_BASIC: dict[str, tuple[type, ...]] = {"string": (str,), "number": (int, float), "integer": (int,), "boolean": (bool,)}


class WorkParameter(BaseModel):
    """A parameter of a work master.

    :param type: string, number, integer, boolean, or a class of the ontology.
    :param minimum, maximum: of numbers, in `unit`.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    id: str = Field(pattern=r"^[A-Za-z_][A-Za-z0-9_]*$")
    type: str
    description: str = ""
    unit: str = ""
    default: Value | None = None
    minimum: FiniteFloat | None = None
    maximum: FiniteFloat | None = None
    choices: tuple[Value, ...] = ()

    @property
    def element_class(self) -> str:
        """The class of the element; "" for a basic type."""
        return "" if self.type in _BASIC else self.type

    def problem(self, value: Value) -> Problem | None:
        """Returns what is wrong with a value, apart from the name of an element."""
        where = f"parameters.{self.id}"
        kinds = _BASIC.get(self.type, (str,))
        if not isinstance(value, kinds) or (isinstance(value, bool) and bool not in kinds):
            expected = self.type if self.type in _BASIC else f"the id of an element of class {self.type}"
            return Problem("wrong_type", where, f"{value!r} is not of type {self.type}", expected)
        if self.choices and value not in self.choices:
            return Problem("wrong_value", where, f"{value!r} is not one of the choices", f"one of {list(self.choices)}")
        if isinstance(value, str) and set('"\n\r') & set(value):
            return Problem("wrong_value", where, "the text has a quote or a line break", "text without them")
        if isinstance(value, int | float):
            low, high = self.minimum, self.maximum
            if (low is not None and not value >= low) or (high is not None and not value <= high):
                limits = f"{low} to {high} {self.unit}".strip()
                return Problem("out_of_limits", where, f"{value} is out of limits", limits)
        return None


class QualityProperty(BaseModel):
    """A property that is read after the job.

    :param element: a parameter of the work master, or the id of an element.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    element: str
    property: str


class WorkMaster(BaseModel):
    """A named goal.

    :param goal: goal text with `{parameter}` in the places of values.
    :param robots: node names of the allowed robots; empty: all.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    id: str = Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9._:\-]{0,127}$")
    description: str = ""
    goal: str
    parameters: tuple[WorkParameter, ...] = ()
    quality: tuple[QualityProperty, ...] = ()
    robots: tuple[str, ...] = ()

    @model_validator(mode="after")
    def _check(self) -> WorkMaster:
        names = [parameter.id for parameter in self.parameters]
        if len(set(names)) < len(names):
            raise ValueError("two parameters have the same id")
        used = set()
        for _, name, spec, conversion in string.Formatter().parse(self.goal):
            if spec or conversion:
                raise ValueError(f"the goal formats {name}, expected only {{{name}}}")
            used |= {name} if name is not None else set()
        if unknown := used - set(names):
            raise ValueError(f"the goal uses {sorted(unknown)}, expected the parameters {sorted(names)}")
        for parameter in self.parameters:
            if parameter.default is not None and (problem := parameter.problem(parameter.default)):
                raise ValueError(f"default: {problem}")
        return self

    def goal_for(self, values: Mapping[str, Value]) -> str:
        """Returns the goal text with values.

        :raises Rejected: with all problems of the values.
        """
        problems = []
        known = {parameter.id: parameter for parameter in self.parameters}
        for key in values:
            if key not in known:
                near = tuple(nearest(key, known) or known)
                problems.append(
                    Problem("unknown_name", f"parameters.{key}", f"{self.id} has no parameter {key!r}", nearest=near)
                )
        filled = self.filled(values)
        for parameter in self.parameters:
            if parameter.id not in filled:
                where = f"parameters.{parameter.id}"
                problems.append(Problem("missing", where, "the parameter has no value", f"a {parameter.type}"))
            elif problem := parameter.problem(filled[parameter.id]):
                problems.append(problem)
        if problems:
            raise Rejected(problems)
        terms = {key: _term(value) for key, value in filled.items()}
        parts = [(text, terms.get(name or "", "")) for text, name, _, _ in string.Formatter().parse(self.goal)]
        length = sum(len(text) + len(term) for text, term in parts)
        if length > MAX_GOAL:
            raise Rejected([Problem("too_long", "goal", f"{length} characters with its values", f"at most {MAX_GOAL}")])
        return "".join(text + term for text, term in parts)

    def filled(self, values: Mapping[str, Value]) -> dict[str, Value]:
        """Returns the values with the defaults."""
        defaults = {p.id: p.default for p in self.parameters if p.default is not None}
        return {**defaults, **values}

    def elements(self, values: Mapping[str, Value]) -> dict[str, tuple[str, str]]:
        """Returns (element, class) by the field of each parameter that names an element."""
        filled = self.filled(values)
        return {
            f"parameters.{p.id}": (str(filled[p.id]), p.element_class)
            for p in self.parameters
            if p.element_class and p.id in filled
        }

    def quality_sources(self, values: Mapping[str, Value]) -> dict[str, tuple[str, str]]:
        """Returns (element, property) by `element.property` of the quality data."""
        filled = self.filled(values)
        return {f"{q.element}.{q.property}": (str(filled.get(q.element, q.element)), q.property) for q in self.quality}

    def parameters_schema(self) -> dict[str, Any]:
        """Returns the JSON Schema of the parameters."""
        types = {"string": "string", "number": "number", "integer": "integer", "boolean": "boolean"}
        properties: dict[str, Any] = {}
        for p in self.parameters:
            class_text = "" if p.type in _BASIC else f"(id of an element of class {p.type})"
            entry = {
                "type": types.get(p.type, "string"),
                "description": f"{p.description} {class_text}".strip(),
                "minimum": p.minimum,
                "maximum": p.maximum,
                "enum": list(p.choices) or None,
                "default": p.default,
            }
            properties[p.id] = {key: value for key, value in entry.items() if value is not None}
        required = [p.id for p in self.parameters if p.default is None]
        return {"type": "object", "properties": properties, "required": required, "additionalProperties": False}


def _term(value: Value) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    return f'"{value}"' if isinstance(value, str) else repr(value)


class _File(BaseModel):
    model_config = ConfigDict(extra="forbid")
    work_masters: list[WorkMaster]


def read_work_masters(path: Path) -> list[WorkMaster]:
    """Reads a YAML file with the list `work_masters`.

    :raises ConfigurationError: with all problems of the file.
    """
    try:
        return _File.model_validate(read_yaml(path.read_text())).work_masters
    except ValidationError as error:
        raise ConfigurationError(f"{path}: " + "; ".join(str(problem) for problem in problems_of(error))) from error
    except (OSError, UnicodeDecodeError, WrongValue) as error:
        raise ConfigurationError(f"{path}: {error}") from error


def work_masters_of(elements: Iterable[Element]) -> tuple[list[WorkMaster], list[str]]:
    """Returns the work masters that elements of the scene define, and what is wrong with the others.

    An element's label is the id; its property `DEFINITION` has the other fields as YAML.
    """
    masters: dict[str, WorkMaster] = {}
    problems = []
    for element in elements:
        try:
            fields = read_yaml(str(element.value_of(DEFINITION) or ""))
            if not isinstance(fields, dict):
                raise ConfigurationError(f"{DEFINITION} is {fields!r}, expected the fields of a work master")
            master = WorkMaster.model_validate({**fields, "id": element.label or element.id})
            if master.id in masters:
                raise ConfigurationError(f"another element defines a work master {master.id!r}")
        except ValidationError as error:
            problems.append(f"{element!r}: " + "; ".join(str(problem) for problem in problems_of(error)))
        except (ConfigurationError, WrongValue) as error:
            problems.append(f"{element!r}: {error}")
        else:
            masters[master.id] = master
    return list(masters.values()), problems


class WorkMasters:
    """The known work masters by id."""

    def __init__(self, masters: Iterable[WorkMaster] = ()) -> None:
        self._of_file = {master.id: master for master in masters}
        self._of_scene: dict[str, WorkMaster] = {}

    def set_of_scene(self, masters: Iterable[WorkMaster]) -> None:
        """Replaces those of the world model. Those of the file win."""
        self._of_scene = {master.id: master for master in masters}

    @property
    def all(self) -> dict[str, WorkMaster]:
        return {**self._of_scene, **self._of_file}

    def get(self, name: str) -> WorkMaster:
        """
        :raises Rejected: there is no such work master.
        """
        known = self.all
        if name not in known:
            near = tuple(nearest(name, known) or sorted(known)[:12])
            raise Rejected([Problem("unknown_name", "work_master", f"there is no work master {name!r}", nearest=near)])
        return known[name]

    def robots_of(self, order: Order) -> tuple[str, ...]:
        """Returns the robots that an order allows; empty: all."""
        return order.robots or (self.get(order.work_master).robots if order.work_master else ())

    def goal_of(self, order: Order) -> str:
        """Returns the goal text of an order.

        :raises Rejected: with all problems of goal, work master and parameters.
        """
        if bool(order.goal) == bool(order.work_master):
            raise Rejected([Problem("wrong_value", "goal", "expected either a goal or a work master")])
        if order.goal:
            if order.parameters:
                raise Rejected([Problem("wrong_value", "parameters", "parameters belong to a work master")])
            return order.goal
        return self.get(order.work_master).goal_for(order.parameters)
