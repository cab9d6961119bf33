"""The choices of the scene dialogs: classes, templates, elements and relations."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from skiros2_common.core.names import id_order, local_name
from skiros2_gui.world.details import display_name
from skiros2_gui.world.scene import SceneHierarchy
from skiros2_world_model.core.vocabulary import Predicate, Vocabulary

CLASS, TEMPLATE = "class", "template"


@dataclass(frozen=True)
class Choice:
    """A class or template, with its subclasses and templates.

    :param kind: `CLASS` or `TEMPLATE`.
    :param text: as displayed.
    """

    name: str
    kind: str
    text: str
    description: str = ""
    children: tuple[Choice, ...] = ()

    def matches(self, words: Sequence[str]) -> bool:
        """Returns whether its name or description contains all words (lower case)."""
        text = f"{self.name} {self.description}".lower()
        return all(word in text for word in words)


def class_choices(vocabulary: Vocabulary, with_templates: bool = True) -> tuple[Choice, ...]:
    """Returns the tree of classes; templates precede subclasses.

    A class with several superclasses is listed below each.
    """
    return tuple(_class_choice(vocabulary, name, with_templates, frozenset()) for name in vocabulary.top_classes())


def _class_choice(vocabulary: Vocabulary, name: str, with_templates: bool, ancestors: frozenset[str]) -> Choice:
    ancestors = ancestors | {name}
    templates = vocabulary.templates(name) if with_templates else []
    # An individual is listed by each of its classes; keep the most specific one.
    own = [t for t in templates if vocabulary.type_of(t) == name]
    below = [c for c in vocabulary.subclasses(name) if c not in ancestors]
    return Choice(
        name,
        CLASS,
        local_name(name),
        vocabulary.description(name),
        (
            *(Choice(t, TEMPLATE, local_name(t), vocabulary.description(t)) for t in own),
            *(_class_choice(vocabulary, c, with_templates, ancestors) for c in below),
        ),
    )


def flat(choices: Sequence[Choice]) -> Iterator[Choice]:
    """Yields all choices of a tree in pre-order."""
    for choice in choices:
        yield choice
        yield from flat(choice.children)


def element_choices(
    hierarchy: SceneHierarchy,
    vocabulary: Vocabulary,
    types: Sequence[str] = (),
    without: str = "",
) -> list[tuple[str, str]]:
    """Returns ids and names of the elements, then of the templates.

    :param types: instances of these classes come first.
    :param without: an id to leave out.
    """
    found = sorted((record.id for record in hierarchy.scene), key=id_order)
    preferred = {name for etype in types for name in vocabulary.ontology.subclasses(etype)}
    if preferred:
        found.sort(key=lambda eid: (record := hierarchy.scene.record(eid)) is None or record.type not in preferred)
    elements = [(eid, display_name(hierarchy, eid)) for eid in found if eid != without]
    return elements + [(name, f"{local_name(name)}  (template)") for name in vocabulary.templates()]


def predicate_choices(vocabulary: Vocabulary, subject_type: str) -> list[tuple[Predicate, bool]]:
    """Returns the relations and whether their domain includes a class; those that do come first."""
    found = [(p, not vocabulary.mismatch(subject_type, p.name, "")) for p in vocabulary.predicates()]
    return sorted(found, key=lambda pair: not pair[1])
