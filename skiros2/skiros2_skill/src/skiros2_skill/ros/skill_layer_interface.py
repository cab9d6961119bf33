"""A client of all skill managers."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from skiros2_common.core.errors import UnknownName
from skiros2_common.core.manager_names import manager_of, matching_name
from skiros2_common.core.world_element import Element
from skiros2_skill.ros.discovery_interface import DiscoveryInterface
from skiros2_skill.ros.skill_manager_interface import SkillManagerInterface

NAMESPACE = "/skill_managers"


class SkillLayerInterface(DiscoveryInterface):
    """Discovers the running skill managers and creates a client for each.

    :param author: named in the managers' logs.
    """

    def __init__(self, author: str = "unknown") -> None:
        self._author = author
        self._agents: dict[str, SkillManagerInterface] = {}
        self._changed = False
        self._monitor_cb: Callable[[Any], None] | None = None
        self._debug: bool | None = None
        self.init_discovery(NAMESPACE, self._on_agent, self._on_agent_gone)

    @property
    def agent(self) -> SkillManagerInterface:
        """The only manager, or the first."""
        return self.get_agent()

    @property
    def agents(self) -> dict[str, SkillManagerInterface]:
        """The clients of the running managers, by node name."""
        # Without the lock of discovery: callers may hold locks that its callbacks, which are called under it, need.
        return dict(self._agents)

    @property
    def has_changes(self) -> bool:
        """Whether managers have come up or gone down since the last read."""
        changed, self._changed = self._changed, False
        return changed

    @property
    def has_active_agents(self) -> bool:
        """Whether any manager has a task that has not ended."""
        return any(agent.tasks for agent in self.agents.values())

    def get_agent(self, agent: str | Element | None = None) -> SkillManagerInterface:
        """The client of a manager, by default of the first.

        :param agent: the manager's node name, with or without leading slash; or the element of its robot.
        :raises UnknownName: no such manager runs.
        """
        agents = self.agents
        if agent is None and agents:
            return next(iter(agents.values()))
        asked = manager_of(agent) if isinstance(agent, Element) else agent or ""
        name = matching_name(asked, agents)
        if not name:
            given = repr(agent) if isinstance(agent, Element) and not asked else asked
            raise UnknownName(f"no skill manager {given} runs; there are: {', '.join(agents) or 'none'}")
        return agents[name]

    def set_monitor_cb(self, cb: Callable[[Any], None] | None) -> None:
        """Sets the callback for each `TreeProgress` of each manager; it is called in threads of ROS."""
        self._monitor_cb = cb
        for agent in self.agents.values():
            agent.set_monitor_cb(cb)

    def set_debug(self, state: bool) -> None:
        """Sets whether progress messages include the parameters."""
        self._debug = state
        for agent in self.agents.values():
            agent.set_debug(state)

    def print_state(self) -> str:
        """The managers and their skills."""
        return "\n".join(agent.print_state() for agent in self.agents.values())

    def shutdown(self) -> None:
        """Stops discovery and closes all clients."""
        self.stop_discovery()
        for agent in self.agents.values():
            agent.shutdown()

    def _on_agent(self, name: str) -> None:
        agent = SkillManagerInterface(name, self._author)
        agent.set_monitor_cb(self._monitor_cb)
        if self._debug is not None:
            agent.set_debug(self._debug)
        self._agents[name] = agent
        self._changed = True

    def _on_agent_gone(self, name: str) -> None:
        self._agents.pop(name).shutdown()
        self._changed = True
