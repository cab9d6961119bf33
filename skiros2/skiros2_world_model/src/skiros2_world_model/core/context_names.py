"""The contexts that every world model has."""

#: The elements that skills, planning and windows see.
SCENE = "scene"

#: The ontologies. It holds no elements.
ONTOLOGY = "ontology"
