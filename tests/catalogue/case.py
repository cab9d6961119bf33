"""A case: a tree, the world that it runs in, what happens to it, and its trace."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from skiros2_common.core.abstract_skill import SkillDescription
from skiros2_skill.core.skill import SkillBase
from skiros2_skill.testing import BenchTask, SkillBench, Trace

#: What may happen before a tick: a function of the world, or the end from outside.
Event = Callable[[SkillBench], Any]
PREEMPT = "preempt"


@dataclass(frozen=True)
class Case:
    """A tree and what it does.

    :param tree: the compound.
    :param trace: after each tick, from the first to the one at which the task ends. A skill that no implementation was
        chosen for yet, nor asked for by label, goes by its type; what a compound has below is there when it starts.
    :param scene: adds to the world what the case needs.
    :param given: the parameters of the command; `"@label"` is the element with that label.
    :param events: by the number of the tick before which they happen.
    :param servers: whether `clients.CatalogueServers` have to run.
    """

    tree: type
    trace: Trace
    scene: Event | None = None
    given: Mapping[str, Any] = field(default_factory=dict)
    events: Mapping[int, Event | str] = field(default_factory=dict)
    servers: bool = False

    @property
    def name(self) -> str:
        return self.tree.__name__

    @property
    def type(self) -> str:
        return _type_name(self.name)

    def params(self, world: SkillBench) -> dict[str, Any]:
        """What the command gives, with the elements as they are in a world."""
        return {
            key: world.element(value[1:]) if isinstance(value, str) and value.startswith("@") else value
            for key, value in self.given.items()
        }

    def play(self, world: SkillBench, ticks: int | None = None) -> BenchTask:
        """Runs the case in this process. Returns the task, with its trace.

        :param ticks: so many; None: as many as its trace has.
        """
        world.import_libraries("catalogue")
        if self.scene is not None:
            self.scene(world)
        task = world.command(self.type, self.name, **self.params(world))
        for tick in range(1, (len(self.trace.ticks) if ticks is None else ticks) + 1):
            event = self.events.get(tick)
            if event == PREEMPT:
                task.preempt()
            elif event is not None:
                event(world)
            task.tick()
        return task


CASES: list[Case] = []


def case(trace: str, **more: Any) -> Callable[[type], type]:
    """Puts a tree into the catalogue; arguments as in `Case`."""

    def register(tree: type) -> type:
        CASES.append(Case(tree, Trace.parse(trace), **more))
        return tree

    return register


class Tree(SkillBase, ABC):
    """A compound that is called as its class. `declares` has the arguments of `addParam` for its parameters."""

    declares: tuple[tuple[Any, ...], ...] = ()

    def createDescription(self) -> None:
        name = self.__class__.__name__
        description = type(_type_name(name), (SkillDescription,), {})()
        self.setDescription(description, name)
        for arguments in self.declares:
            self.addParam(*arguments)

    @abstractmethod
    def expand(self, skill: Any) -> None:
        """The tree."""

    def act(self, script: str = "S", **more: str) -> Any:
        """A leaf whose ticks end as a script says; see `parts.act`."""
        return self.skill("Act", "act", specify={"Script": script, **more})


def _type_name(name: str) -> str:
    return "".join(word.capitalize() for word in name.split("_")) + "Case"
