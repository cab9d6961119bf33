"""Names and IRIs: `skiros:Robot` stands for `http://rvmi.aau.dk/ontologies/skiros.owl#Robot`.

In memory and in messages everything has a name, `prefix:Local`; IRIs are used only to read, write and query RDF. The
prefix of an ontology is the last segment of its IRI, in lower case and without extension; its namespace is the IRI
followed by `#`. Prefix declarations in files have no effect outside the file.
"""

from __future__ import annotations

import re

from skiros2_common.core.names import DEFAULT_PREFIX, full_name

RDF = "http://www.w3.org/1999/02/22-rdf-syntax-ns#"
RDFS = "http://www.w3.org/2000/01/rdf-schema#"
OWL = "http://www.w3.org/2002/07/owl#"
XSD = "http://www.w3.org/2001/XMLSchema#"

#: The standard vocabularies of RDF and OWL.
STANDARD = {"rdf": RDF, "rdfs": RDFS, "owl": OWL, "xsd": XSD}

#: The namespace of an undeclared prefix, chosen so that the rule above maps it back to the prefix.
_UNKNOWN = "http://rvmi.aau.dk/ontologies/{}.owl#"

#: A prefix in Turtle and SPARQL (PN_PREFIX in their grammars).
_LETTERS = (
    "A-Za-z\u00c0-\u00d6\u00d8-\u00f6\u00f8-\u02ff\u0370-\u037d\u037f-\u1fff\u200c-\u200d\u2070-\u218f\u2c00-\u2fef"
    "\u3001-\ud7ff\uf900-\ufdcf\ufdf0-\ufffd\U00010000-\U000effff"
)
_OTHERS = "_0-9\u00b7\u0300-\u036f\u203f-\u2040-"
_PREFIX = f"[{_LETTERS}](?:[{_LETTERS}{_OTHERS}.]*[{_LETTERS}{_OTHERS}])?"
#: The usual ones. The whole pattern takes 5 ms to compile, in each node that starts.
_ASCII_PREFIX = re.compile("[A-Za-z](?:[A-Za-z_0-9.-]*[A-Za-z_0-9-])?")


def prefix_of(ontology_iri: str) -> str:
    """The prefix of an ontology: `http://x.org/coraX.owl` gives `corax`."""
    segment = ontology_iri.rstrip("#/").replace("#", "/").rpartition("/")[2]
    stem, dot, _ = segment.rpartition(".")
    return (stem if dot and stem else segment).lower()


class Prefixes:
    """The known namespaces and their prefixes; converts between names and IRIs.

    The first namespace to claim a prefix gets it. Names in a namespace without a prefix stay IRIs, which are valid
    names everywhere. Reading is thread-safe; adding requires the lock of the world model.
    """

    def __init__(self) -> None:
        self._namespaces: dict[str, str] = dict(STANDARD)
        self._prefixes: dict[str, str] = {namespace: prefix for prefix, namespace in STANDARD.items()}

    def namespaces(self) -> dict[str, str]:
        """The namespaces by prefix, with the empty prefix for the default namespace."""
        known = dict(self._namespaces)
        if DEFAULT_PREFIX in known:
            known[""] = known[DEFAULT_PREFIX]
        return known

    def add_ontology(self, iri: str) -> str:
        """Assigns an ontology its prefix, unless it is taken. Returns its prefix, or else its namespace."""
        return self.add_namespace(iri.rstrip("#") + "#")

    def add_namespace(self, namespace: str) -> str:
        """Assigns a namespace its prefix. Returns the prefix, or the namespace when the prefix is taken or invalid."""
        known = self._prefixes.get(namespace)
        if known is not None:
            return known
        prefix = prefix_of(namespace)
        if prefix in self._namespaces or not (_ASCII_PREFIX.fullmatch(prefix) or re.fullmatch(_PREFIX, prefix)):
            return namespace
        self._namespaces[prefix] = namespace
        self._prefixes[namespace] = prefix
        return prefix

    def remove(self, prefix: str) -> None:
        """Removes a prefix; no effect when it is unknown."""
        namespace = self._namespaces.pop(prefix, None)
        if namespace is not None:
            self._prefixes.pop(namespace, None)

    def has(self, prefix: str) -> bool:
        """Whether a prefix is assigned."""
        return prefix in self._namespaces

    def name(self, iri: str) -> str:
        """The name of an IRI. Assigns a prefix to an unknown `#` namespace."""
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
        """The IRI of a name or IRI. Assigns a namespace to an unknown prefix."""
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
    """Whether a text is an IRI, not `prefix:Name`."""
    return "://" in text or text.startswith("urn:")
