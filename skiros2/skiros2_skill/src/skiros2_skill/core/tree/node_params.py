"""The names that a node's parameters have above it, and the values that it was given for them."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from typing import Any

from skiros2_common.core.abstract_skill import SkillCore
from skiros2_common.core.params import ParamHandler, ParamTypes

log = logging.getLogger(__name__)


class NodeParams(SkillCore):
    """A skill whose parameters are renamed and fixed by the tree that it is in."""

    def __init__(self) -> None:
        super().__init__()
        self._remaps: dict[str, str] = {}
        self._scope: Mapping[str, str] = {}  # the remaps of the nodes down to this one, in one; known once it starts
        self._specified: dict[str, list[Any]] = {}
        self._suggested: dict[str, list[Any]] = {}

    def remap(self, initial_key: str, target_key: str, record: bool = True) -> None:
        """The key `initial_key` of this node, or of one below it, is `target_key` for the nodes above.

        A key that is remapped already keeps its name, with a warning.
        """
        if initial_key in self._remaps:
            log.warning(
                "%s: %r is remapped to %r already; the remap to %r is ignored",
                self.printState(), initial_key, self._remaps[initial_key], target_key,
            )  # fmt: skip
            return
        key = next((key for key, above in self._remaps.items() if above == initial_key), initial_key)
        if record or key in self._remaps:
            self._remaps[key] = target_key
        if initial_key in self._specified:
            self._specified[target_key] = self._specified.pop(initial_key)

    def get_remap(self, key: str) -> str:
        """The name that a key of this node has one level up."""
        return self._remaps.get(key, key)

    name_above = get_remap

    def own_name(self, name: str) -> str:
        """The key of this node that has that name one level up."""
        return next((key for key, above in self._remaps.items() if above == name), name) if self._remaps else name

    def getParamsNoRemaps(self) -> ParamHandler:
        """The parameters under the keys that the skill itself uses."""
        return self._params

    # -- fixed parameters --------------------------------------------------------------------------------------

    def specifyParam(self, key: str, values: Any) -> None:
        """Sets a parameter, by the name it has one level up, until the node starts; see `specifyParamDefault`."""
        self.params.specify(key, values)

    def specifyParamDefault(self, key: str, values: Any) -> None:
        """Fixes a parameter, by the name it has one level up: it starts with these values each time.

        A key that the skill has not is logged and ignored when the node starts.
        """
        self._specified[key] = [] if values is None else values if isinstance(values, list) else [values]

    def specifyParamsDefault(self, input_params: ParamHandler) -> None:
        """Fixes parameters to the values that others have, such as those of a plan, by the names one level up.

        An element for an Inferred parameter is not fixed: it is tried first, and replaced by another where the
        pre-conditions do not hold with it.
        """
        for key, param in input_params.items():
            if param.values and param.is_element and param.paramTypeIs(ParamTypes.Inferred):
                self._suggested[key] = list(param.values)
            elif param.values:
                self.specifyParamDefault(key, list(param.values))

    def specifyParams(self, input_params: ParamHandler, keep_default: bool = True) -> None:
        """Fixes parameters to the values that others have; with `keep_default`, what is fixed already stays."""
        for key, param in input_params.items():
            if param.values and not (keep_default and key in self._specified):
                self.specifyParamDefault(key, list(param.values))
