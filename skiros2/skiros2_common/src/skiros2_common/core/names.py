"""Names of the ontology as people write them.

A name is `prefix:Name`. `:Name` and `Name` stand for the default prefix.
"""

DEFAULT_PREFIX = "skiros"


def full_name(name: str, default: str = DEFAULT_PREFIX) -> str:
    """`contain` and `:contain` as `skiros:contain`; a name with a prefix, an IRI and "" stay as they are."""
    if not name:
        return name
    prefix, colon, local = name.partition(":")
    if not colon:
        return f"{default}:{name}"
    if not prefix:
        return f"{default}:{local}"
    return name


def local_name(name: str) -> str:
    """The part after the prefix: `skiros:contain` gives `contain`."""
    return name.rpartition(":")[2]
