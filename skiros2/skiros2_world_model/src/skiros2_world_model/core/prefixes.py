"""Names and IRIs: `skiros:Robot` stands for `http://rvmi.aau.dk/ontologies/skiros.owl#Robot`.

In memory and on the wire everything has a name, `prefix:Local`; IRIs exist only where RDF is read, written or queried.
The prefix of an ontology is the last segment of its IRI, in lower case and without extension; its namespace is the IRI
with `#`. Prefix declarations inside files are the files' own business and never change these.
"""

from __future__ import annotations

import re

from skiros2_common.core.names import DEFAULT_PREFIX, full_name

RDF = "http://www.w3.org/1999/02/22-rdf-syntax-ns#"
RDFS = "http://www.w3.org/2000/01/rdf-schema#"
OWL = "http://www.w3.org/2002/07/owl#"
XSD = "http://www.w3.org/2001/XMLSchema#"

#: The vocabularies that RDF and OWL themselves are written in.
STANDARD = {"rdf": RDF, "rdfs": RDFS, "owl": OWL, "xsd": XSD}

#: Where a prefix that no ontology has gets its namespace, so that the rule above leads back to the prefix.
_UNKNOWN = "http://rvmi.aau.dk/ontologies/{}.owl#"

#: What Turtle and SPARQL take as a prefix (PN_PREFIX of their grammars).
_LETTERS = (
    "A-Za-z\u00c0-\u00d6\u00d8-\u00f6\u00f8-\u02ff\u0370-\u037d\u037f-\u1fff\u200c-\u200d\u2070-\u218f\u2c00-\u2fef"
    "\u3001-\ud7ff\uf900-\ufdcf\ufdf0-\ufffd\U00010000-\U000effff"
)
_OTHERS = "_0-9\u00b7\u0300-\u036f\u203f-\u2040-"
_PREFIX = re.compile(f"[{_LETTERS}](?:[{_LETTERS}{_OTHERS}.]*[{_LETTERS}{_OTHERS}])?")


def prefix_of(ontology_iri: str) -> str:
    """The prefix of an ontology: `http://x.org/coraX.owl` gives `corax`."""
    segment = ontology_iri.rstrip("#/").replace("#", "/").rpartition("/")[2]
    stem, dot, _ = segment.rpartition(".")
    return (stem if dot and stem else segment).lower()


class Prefixes:
    """The namespaces that are known, and names from IRIs and back.

    The first namespace to claim a prefix has it. Names in a namespace without a prefix stay whole IRIs, which work as
    names everywhere. Reading is safe in all threads; adding happens under the lock of the world model.
    """

    def __init__(self) -> None:
        self._namespaces: dict[str, str] = dict(STANDARD)
        self._prefixes: dict[str, str] = {namespace: prefix for prefix, namespace in STANDARD.items()}

    def namespaces(self) -> dict[str, str]:
        """Namespace by prefix, with the empty prefix for the default one."""
        known = dict(self._namespaces)
        if DEFAULT_PREFIX in known:
            known[""] = known[DEFAULT_PREFIX]
        return known

    def add_ontology(self, iri: str) -> str:
        """Gives an ontology its prefix, unless another namespace has it, and returns its prefix or namespace."""
        return self.add_namespace(iri.rstrip("#") + "#")

    def add_namespace(self, namespace: str) -> str:
        """Gives a namespace the prefix that the rule says; returns it, or the namespace when it cannot have it.

        Another namespace may have it, or what the rule says is no prefix for RDF.
        """
        known = self._prefixes.get(namespace)
        if known is not None:
            return known
        prefix = prefix_of(namespace)
        if prefix in self._namespaces or not _PREFIX.fullmatch(prefix):
            return namespace
        self._namespaces[prefix] = namespace
        self._prefixes[namespace] = prefix
        return prefix

    def remove(self, prefix: str) -> None:
        """Forgets a prefix; nothing happens when it is not known."""
        namespace = self._namespaces.pop(prefix, None)
        if namespace is not None:
            self._prefixes.pop(namespace, None)

    def has(self, prefix: str) -> bool:
        """Whether a namespace has that prefix."""
        return prefix in self._namespaces

    def name(self, iri: str) -> str:
        """The name of an IRI. A `#` namespace that is seen for the first time gets its prefix now."""
        namespace, mark, local = iri.rpartition("#")
        if not mark or not local:
            return iri
        prefix = self._prefixes.get(namespace + "#")
        if prefix is None:
            prefix = self.add_namespace(namespace + "#")
            if prefix.endswith("#"):
                return iri
        return f"{prefix}:{local}"

    def iri(self, name: str) -> str:
        """The IRI of a name, or of an IRI itself. An unknown prefix gets a namespace now."""
        prefix, colon, local = name.partition(":")
        namespace = self._namespaces.get(prefix) if colon else None
        if namespace is not None:
            return namespace + local
        if is_iri(name):
            return name
        prefix, _, local = full_name(name).partition(":")
        if prefix not in self._namespaces:
            self.add_namespace(_UNKNOWN.format(prefix))
        return self._namespaces.get(prefix, _UNKNOWN.format(prefix)) + local


def is_iri(text: str) -> bool:
    """Whether a text is a whole IRI, not `prefix:Name`."""
    return "://" in text or text.startswith("urn:")
