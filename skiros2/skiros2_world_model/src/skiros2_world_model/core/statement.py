"""A statement about the ontologies, as text."""

#: Subject, predicate, object, and whether it is to be there or not.
Statement = tuple[str, str, str, bool]
