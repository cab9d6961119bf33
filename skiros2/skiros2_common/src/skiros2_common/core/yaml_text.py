"""YAML from files and messages. A few hundred bytes of YAML can stand for gigabytes: aliases may refer to aliases."""

from __future__ import annotations

from typing import Any

import yaml

from skiros2_common.core.errors import WrongValue

#: The most characters of a text, and the most that it may stand for beside a multiple of its length.
_MAX_LENGTH, _MAX_EXPANDED, _MAX_FACTOR = 1024**2, 1024**2, 20
#: The maximum nesting depth of lists and dicts.
_MAX_DEPTH = 100


def read_yaml(text: str, *, unique_keys: bool = False) -> Any:
    """Reads the data of a YAML text; tags of Python objects are refused.

    :param unique_keys: whether a key that occurs twice in a mapping is refused; otherwise its last value counts.
    :raises WrongValue: it is not YAML, too long or nested too deeply, or stands for too much by its aliases.
    """
    if len(text) > _MAX_LENGTH:
        raise WrongValue(f"expected at most {_MAX_LENGTH} characters of YAML, got {len(text)}")
    try:
        return _Loader(text, unique_keys).get_single_data()
    except yaml.YAMLError as error:
        raise WrongValue(" ".join(str(error).split())) from None
    except (ValueError, TypeError, ArithmeticError, LookupError, AttributeError) as error:  # PyYAML's, of values
        raise WrongValue(f"a value does not fit its tag or form: {error}") from None


class _Loader(yaml.SafeLoader):  # type: ignore[misc]
    def __init__(self, text: str, unique_keys: bool) -> None:
        super().__init__(text)
        self._unique_keys = unique_keys
        self._most = _MAX_EXPANDED + _MAX_FACTOR * len(text)
        self._depth = 0
        #: Characters and nodes that each complete node stands for.
        self._sizes: dict[yaml.Node, int] = {}

    def compose_node(self, parent: yaml.Node | None, index: Any) -> yaml.Node | None:
        mark = self.peek_event().start_mark
        if self._depth == _MAX_DEPTH:
            raise yaml.MarkedYAMLError(problem=f"nested more than {_MAX_DEPTH} deep", problem_mark=mark)
        is_alias = self.check_event(yaml.AliasEvent)
        self._depth += 1
        node = super().compose_node(parent, index)
        self._depth -= 1
        if node is not None and node not in self._sizes:
            if is_alias:
                raise yaml.MarkedYAMLError(problem="an alias refers to what contains it", problem_mark=mark)
            self._sizes[node] = self._size_of(node)
            if self._sizes[node] > self._most:
                problem = f"by its aliases, the text stands for more than {self._most} characters"
                raise yaml.MarkedYAMLError(problem=problem, problem_mark=mark)
        return node

    def compose_mapping_node(self, anchor: str | None) -> yaml.MappingNode:
        node: yaml.MappingNode = super().compose_mapping_node(anchor)
        known: set[str] = set()
        for key, _ in node.value if self._unique_keys else ():
            if isinstance(key, yaml.ScalarNode) and key.value in known:
                raise yaml.MarkedYAMLError(problem=f"the key {key.value!r} occurs twice", problem_mark=key.start_mark)
            known.add(str(key.value))
        return node

    def _size_of(self, node: yaml.Node) -> int:
        if isinstance(node, yaml.ScalarNode):
            return 1 + len(node.value)
        parts = [part for pair in node.value for part in pair] if isinstance(node, yaml.MappingNode) else node.value
        return 1 + sum(self._sizes[part] for part in parts)
