"""Text helpers of the contract."""

import re


def ontology_type2name(ontology_type: str) -> str:
    """A Python-friendly name for an ontology type: `skiros:LargeBox` gives `skiros_LargeBox`."""
    return re.sub(r"\W", "_", ontology_type)


def ontology_type2name_dict(ontology_type: str) -> dict[str, str]:
    """The parts of an ontology type: `skiros:LargeBox` gives `{"prefix": "skiros", "name": "LargeBox"}`."""
    prefix, _, name = ontology_type.rpartition(":")
    return {"prefix": prefix, "name": name}
