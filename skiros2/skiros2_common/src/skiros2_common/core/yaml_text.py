"""YAML from files and messages. A few hundred bytes of YAML can stand for gigabytes: aliases may refer to aliases."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from typing import Any

import yaml

from skiros2_common.core.errors import WrongValue

#: The most characters of a text, and the most that it may stand for beside a multiple of its length.
_MAX_LENGTH, _MAX_EXPANDED, _MAX_FACTOR = 1024**2, 1024**2, 20
#: The maximum nesting depth of lists and dicts.
_MAX_DEPTH = 100


def read_yaml(text: str) -> Any:
    """Reads the data of a YAML text; tags of Python objects are refused. Of a key that occurs twice in a mapping, the
    last value counts.

    :raises WrongValue: it is not YAML, too long or nested too deeply, or stands for too much by its aliases.
    """
    return YamlText(text).data


class YamlText:
    """The data of a YAML text, as of `read_yaml`, and the lines of its keys.

    :raises WrongValue: same as `read_yaml`.
    """

    def __init__(self, text: str) -> None:
        if len(text) > _MAX_LENGTH:
            raise WrongValue(f"expected at most {_MAX_LENGTH} characters of YAML, got {len(text)}")
        try:
            loader = _Loader(text)
            self._root = loader.get_single_node()
            #: The paths of keys that occur twice in a mapping.
            self.repeated = _repeated(self._root) if loader.has_repeated else []
            self.data: Any = None if self._root is None else loader.construct_document(self._root)
        except yaml.YAMLError as error:
            raise WrongValue(" ".join(str(error).split())) from None
        except (ValueError, TypeError, ArithmeticError, LookupError, AttributeError) as error:  # PyYAML's, of values
            raise WrongValue(f"a value does not fit its tag or form: {error}") from None

    def line(self, path: Iterable[str | int]) -> int:
        """Returns the line, from 1, of the deepest part of a path that the text has; 0 if it has none.

        :param path: keys of mappings, as texts, and indices of lists.
        """
        node, line = self._root, 0
        for part in path:
            if isinstance(node, yaml.MappingNode):
                pairs = {key.value: (key, value) for key, value in node.value if isinstance(key, yaml.ScalarNode)}
                key, node = pairs.get(str(part), (None, None))
            elif isinstance(node, yaml.SequenceNode) and isinstance(part, int) and part < len(node.value):
                key = node = node.value[part]
            else:
                break
            if key is None:
                break
            line = key.start_mark.line + 1
        return line


def _repeated(root: yaml.Node) -> list[tuple[str | int, ...]]:
    found: list[tuple[str | int, ...]] = []
    seen: set[int] = set()
    pending: list[tuple[tuple[str | int, ...], yaml.Node]] = [((), root)]
    while pending:
        path, node = pending.pop()
        if id(node) in seen or isinstance(node, yaml.ScalarNode):
            continue  # an alias
        seen.add(id(node))
        if isinstance(node, yaml.SequenceNode):
            pending += [((*path, i), part) for i, part in enumerate(node.value)]
            continue
        counts = Counter(key.value for key, _ in node.value if isinstance(key, yaml.ScalarNode))
        found += [(*path, key) for key, count in counts.items() if count > 1]
        pending += [((*path, key.value), part) for key, part in node.value if isinstance(key, yaml.ScalarNode)]
    return found


class _Loader(yaml.SafeLoader):  # type: ignore[misc]
    def __init__(self, text: str) -> None:
        super().__init__(text)
        self.has_repeated = False
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
        for key, _ in node.value:
            if isinstance(key, yaml.ScalarNode) and key.value in known:
                self.has_repeated = True
            known.add(str(key.value))
        return node

    def _size_of(self, node: yaml.Node) -> int:
        if isinstance(node, yaml.ScalarNode):
            return 1 + len(node.value)
        parts = [part for pair in node.value for part in pair] if isinstance(node, yaml.MappingNode) else node.value
        return 1 + sum(self._sizes[part] for part in parts)
