"""The world model in one process: reads, lookups, SPARQL, files and memory, beside rdflib on the same statements."""

from __future__ import annotations

import random
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import pyoxigraph as ox
import rdflib

from benchmarks.measurement import Measurement, paired, seconds_per_call
from skiros2_common.core.operations import Add
from skiros2_common.core.params import ParamHandler, ParamTypes
from skiros2_common.core.property_conditions import ConditionProperty
from skiros2_common.core.world_element import Element
from skiros2_world_model.core.local_world_model import LocalWorldModel, source_ontologies
from skiros2_world_model.core.replica_transport import ReplicaTransport
from skiros2_world_model.core.world_model import WorldModel
from skiros2_world_model.core.world_model_client import WorldModelClient
from support.replicated import ReplicatedTransport

RUNS = 5
FEW, SOME, MANY = 100, 5_000, 100_000

#: What a read may take (µs), a lookup (ms), and an element in memory (bytes).
READ_LIMIT, RESOLVE_LIMIT, MEMORY_LIMIT = 5.0, 1.0, 3_000.0

POSE = ("PositionX", "PositionY", "PositionZ", "OrientationX", "OrientationY", "OrientationZ", "OrientationW")
SKIROS = "http://rvmi.aau.dk/ontologies/skiros.owl#"
NAMESPACES = {"skiros": SKIROS, "rdfs": str(rdflib.RDFS), "sumo": "http://www.ontologyportal.org/SUMO.owl#"}

#: A part of the scene is read at many places, so that the processor's cache does not hold all of it.
PLACES = 2_000


def measure(folder: Path) -> Iterator[Measurement]:
    few, many = World(folder, FEW), World(folder, MANY)
    yield from _reads(few, many)
    yield from _lookups(few, many)
    some = World(folder, SOME)
    yield from _files(many, some)
    yield _instantiation(folder)
    yield from _queries(some)
    yield from _memory(folder)


class World:
    """A world model with a scene of so many elements, and a client's replica of it."""

    def __init__(self, folder: Path, size: int) -> None:
        self.workspace = folder / f"scene-{size}"
        self.workspace.mkdir(exist_ok=True)
        self.size = size
        self.model = WorldModel(source_ontologies(), self.workspace)
        fill(self.model, size)
        self.client = WorldModelClient(ReplicaTransport(ReplicatedTransport("bench", self.model)))
        ids = [node.id for node in self.model.scene() if node.type != "skiros:Scene"]
        self.places = random.Random(1).choices(ids, k=PLACES)

    def each(self, read: Callable[[str], object]) -> float:
        """The mean time of a read (µs), each of another element."""
        start = time.perf_counter()
        for eid in self.places:
            read(eid)
        return 1e6 * (time.perf_counter() - start) / len(self.places)


def fill(model: WorldModel, size: int) -> None:
    """Adds elements, a thousand in a request: each in the scene and beside the one before it."""
    for start in range(0, size, 1000):
        numbers = range(start, min(start + 1000, size))
        model.transact([Add(element(n, size), str(n)) for n in numbers], "bench")


def element(number: int, size: int) -> Element:
    """An element with ten floats, texts and a bool; ten of each scene are starters, and ten are full."""
    made = Element("skiros:Starter" if number % (size // 10) == 3 else "skiros:Product", f"product {number}")
    for index, key in enumerate(POSE):
        made.setProperty(f"skiros:{key}", number + index / 7)
    for index, key in enumerate(("SizeX", "SizeY", "SizeZ")):
        made.setProperty(f"skiros:{key}", (number % 20 + index) / 10)  # of one out of twenty sorts
    made.setProperty("skiros:ContainerState", "Full" if number % (size // 10) == 7 else "Empty")
    made.setProperty("skiros:FrameId", "map")
    made.setProperty("skiros:PushToTf", number % 2 == 0)
    made.addRelation("skiros:Scene-0", "skiros:contain", "-1")
    if number % 1000:
        made.addRelation("-1", "skiros:at", f"#{number - 1}")
    return made


# -- reads ---------------------------------------------------------------------------------------------------------


def _reads(few: World, many: World) -> Iterator[Measurement]:
    graph = _rdflib_graph(few)
    contain = rdflib.URIRef(SKIROS + "contain")
    root = rdflib.URIRef(SKIROS + "Scene-0")

    def peer(read: Callable[[Any], object]) -> Callable[[], float]:
        subjects = [rdflib.URIRef(SKIROS + eid.partition(":")[2]) for eid in few.places]

        def run() -> float:
            start = time.perf_counter()
            for subject in subjects:
                read(subject)
            return 1e6 * (time.perf_counter() - start) / len(subjects)

        return run

    reads: list[tuple[str, Callable[[World], Callable[[str], object]], Callable[[Any], object]]] = [
        ("element", lambda w: w.client.get_element, lambda s: list(graph.predicate_objects(s))),
        ("relation", _relation, lambda s: (root, contain, s) in graph),
        ("property condition", _condition, lambda s: graph.value(s, rdflib.URIRef(SKIROS + "ContainerState"))),
    ]
    for name, read, peer_read in reads:
        in_many, in_few = read(many), read(few)
        title = f"replica: read of a {name}" if name != "element" else "replica: read of an element"
        yield paired(
            f"{title}, {MANY} elements",
            lambda r=in_many: many.each(r),  # type: ignore[misc]
            "the limit",
            lambda: READ_LIMIT,
            unit="µs",
            runs=RUNS,
            target=1.0,
        )
        yield paired(
            f"{title}, {MANY} elements",
            lambda r=in_many: many.each(r),  # type: ignore[misc]
            f"the same, {FEW} elements",
            lambda r=in_few: few.each(r),  # type: ignore[misc]
            unit="µs",
            runs=RUNS,
        )
        yield paired(
            f"{title}, {FEW} elements",
            lambda r=in_few: few.each(r),  # type: ignore[misc]
            "rdflib, the same statements",
            peer(peer_read),
            unit="µs",
            runs=RUNS,
        )


def _relation(world: World) -> Callable[[str], object]:
    root = world.client.get_element("skiros:Scene-0")
    elements = {eid: world.client.get_element(eid) for eid in world.places}
    return lambda eid: world.client.check_relation(root, "skiros:contain", elements[eid], True, False)


def _condition(world: World) -> Callable[[str], object]:
    condition = ConditionProperty("is empty", "skiros:ContainerState", "Object", "=", "Empty", True)
    handlers = {}
    for eid in world.places:
        handlers[eid] = ParamHandler()
        handlers[eid].addParam("Object", Element("skiros:Product"), ParamTypes.Required)
        handlers[eid].specify("Object", world.client.get_element(eid))
    return lambda eid: condition.evaluate(handlers[eid], world.client)


# -- lookups -------------------------------------------------------------------------------------------------------


def _lookups(few: World, many: World) -> Iterator[Measurement]:
    wanted = {
        "class": {"etype": "skiros:Starter"},
        "property value": {"values": {"ContainerState": "Full"}},
        "class and value": {"etype": "skiros:Product", "values": {"ContainerState": "Full"}},
        "class above and value": {"etype": "sumo:Object", "values": {"ContainerState": "Full"}},
    }
    for name, asked in wanted.items():
        like = _abstract(**asked)  # type: ignore[arg-type]
        found = [len(world.model.reader.matching(like, "scene")) for world in (few, many)]
        if found != [10, 10]:
            raise RuntimeError(f"resolve by {name} found {found} elements")
        yield paired(
            f"resolve of 10 among {MANY} by {name}",
            lambda like=like: _resolve_ms(many, like),  # type: ignore[misc]
            "the limit",
            lambda: RESOLVE_LIMIT,
            unit="ms",
            runs=RUNS,
            target=1.0,
        )


def _abstract(etype: str = "", values: dict[str, object] | None = None) -> Element:
    like = Element(etype)
    for key, value in (values or {}).items():
        like.setProperty(f"skiros:{key}", value)
    return like


def _resolve_ms(world: World, like: Element) -> float:
    return 1e3 * seconds_per_call(lambda: world.model.reader.matching(like, "scene"), 200)


# -- files ---------------------------------------------------------------------------------------------------------


def _files(many: World, some: World) -> Iterator[Measurement]:
    """Oxigraph has the large scene, rdflib the smaller one: for the large one it would take two minutes."""
    path = _saved(many)
    triples = [quad.triple for quad in ox.parse(path=str(path), format=ox.RdfFormat.TURTLE)]
    yield _beside(many, "load", "Oxigraph's parser", lambda: _parse(path))
    yield _beside(many, "save", "Oxigraph's serialiser", lambda: _serialise(triples))
    path, graph = _saved(some), rdflib.Graph()
    yield _beside(some, "load", "rdflib's parser", lambda: graph.parse(path), 2.0)
    yield _beside(some, "save", "rdflib's serialiser", lambda: graph.serialize(), 2.0)


def _saved(world: World) -> Path:
    return world.model.save("bench.ttl")


def _beside(
    world: World, name: str, peer_name: str, peer: Callable[[], object], target: float | None = None
) -> Measurement:
    ours = {"load": lambda: world.model.load("bench.ttl", "bench"), "save": lambda: _saved(world)}[name]
    return paired(
        f"{name} of {world.size} elements",
        lambda: _timed(ours),
        peer_name,
        lambda: _timed(peer),
        unit="s",
        runs=2,
        warm_up=0,
        target=target,
    )


def _parse(path: Path) -> list[ox.Quad]:
    return list(ox.parse(path=str(path), format=ox.RdfFormat.TURTLE))


def _serialise(triples: Sequence[ox.Triple]) -> bytes | None:
    return ox.serialize(triples, format=ox.RdfFormat.TURTLE, prefixes=NAMESPACES)


# -- instantiation -------------------------------------------------------------------------------------------------


def _instantiation(folder: Path) -> Measurement:
    """A robot with twenty parts from its template, beside as many statements that rdflib is told."""
    workspace = folder / "robot"
    workspace.mkdir()
    robot = "@prefix : <" + SKIROS + "> .\n@prefix owl: <http://www.w3.org/2002/07/owl#> .\n"
    robot += (
        ":bench_robot a owl:NamedIndividual, :Product ; :hasA " + ", ".join(f":part_{n}" for n in range(20)) + " .\n"
    )
    robot += "".join(
        f":part_{n} a owl:NamedIndividual, :Product ; " + " ; ".join(f":{key} {n}.5" for key in POSE) + " .\n"
        for n in range(20)
    )
    (workspace / "robot.owl").write_text(robot)
    client = LocalWorldModel("bench", WorldModel(source_ontologies(), workspace))
    made = client.instanciate("skiros:bench_robot", recursive=True)
    if len(client.get_branch(made.id)) != 21:
        raise RuntimeError("the robot has not its twenty parts")
    template = rdflib.Graph().parse(data=robot, format="turtle")

    def peer() -> None:
        copy = rdflib.Graph()
        for s, p, o in template:
            copy.add((rdflib.URIRef(f"{s}-1"), p, o))

    return paired(
        "instantiation of a robot with 20 parts, one request",
        lambda: 1e3 * seconds_per_call(lambda: client.instanciate("skiros:bench_robot", recursive=True), 50),
        "rdflib, adding the same statements",
        lambda: 1e3 * seconds_per_call(peer, 50),
        unit="ms",
        runs=RUNS,
    )


# -- SPARQL --------------------------------------------------------------------------------------------------------

QUERIES = {
    "class": "SELECT ?x WHERE { ?x rdf:type/rdfs:subClassOf* skiros:Starter }",
    "relation with types": "SELECT ?x ?y WHERE { ?x skiros:at ?y . ?x rdf:type skiros:Starter . "
    "?y rdf:type/rdfs:subClassOf* skiros:Product }",
}


def _queries(world: World) -> Iterator[Measurement]:
    graph = _rdflib_graph(world)
    names = {**NAMESPACES, "rdf": str(rdflib.RDF)}
    for path in sorted(source_ontologies().glob("*.ttl")):
        graph.parse(path)
    for name, query in QUERIES.items():
        ours, peers = len(world.model.query(query)), len(list(graph.query(query, initNs=names)))
        if not ours or ours != peers:
            raise RuntimeError(f"SPARQL by {name} finds {ours} rows, rdflib {peers}")
        yield paired(
            f"SPARQL by {name}, {SOME} elements",
            lambda query=query: 1e3 * seconds_per_call(lambda: world.model.query(query), 20),  # type: ignore[misc]
            "rdflib's default store",
            lambda query=query: 1e3 * seconds_per_call(lambda: list(graph.query(query, initNs=names)), 1),  # type: ignore[misc]
            unit="ms",
            runs=RUNS,
            target=0.1,
        )


def _rdflib_graph(world: World) -> rdflib.Graph:
    return rdflib.Graph().parse(world.model.save("bench.ttl"))


# -- memory --------------------------------------------------------------------------------------------------------


def _memory(folder: Path) -> Iterator[Measurement]:
    """Bytes of resident memory for an element, each figure in a process of its own."""
    peer = _bytes_per_element("rdflib", folder)
    for kind, title, peer_name, peer_bytes, target in (
        ("index", "memory of an element, without SPARQL", "the limit", MEMORY_LIMIT, 1.0),
        ("index", "memory of an element, without SPARQL", "rdflib's default store", peer, None),
        ("mirror", "memory of an element, once SPARQL was asked", "rdflib's default store", peer, None),
    ):
        ours = _bytes_per_element(kind, folder)
        yield Measurement(title, ours, "B", 1, peer_name, peer_bytes, ours / peer_bytes, target)


def _bytes_per_element(kind: str, folder: Path) -> float:
    """What this file, run as a program, says."""
    command = [sys.executable, str(Path(__file__).resolve()), kind, str(folder)]
    done = subprocess.run(command, check=True, capture_output=True, text=True, env={"PYTHONPATH": ":".join(sys.path)})
    return float(done.stdout.split()[-1])


def _main(kind: str, folder: Path) -> None:
    size = 20_000
    workspace = folder / "memory"
    workspace.mkdir(exist_ok=True)
    model = WorldModel(source_ontologies(), workspace)
    fill(model, 1000)  # what is needed once
    if kind == "rdflib":
        fill(model, size)
        path = model.save("memory.ttl")
        graph = rdflib.Graph()
        before = _resident()
        graph.parse(path)
        print((_resident() - before) / (size + 1000))
        return
    before = _resident()
    fill(model, size)
    if kind == "mirror":
        model.query("ASK { ?s ?p ?o }")
    print((_resident() - before) / size)


def _resident() -> int:
    """The resident memory of this process (bytes)."""
    status = Path("/proc/self/status").read_text()
    return 1024 * int(status.partition("VmRSS:")[2].split()[0])


def _timed(call: Callable[[], object]) -> float:
    start = time.perf_counter()
    call()
    return time.perf_counter() - start


if __name__ == "__main__":
    _main(sys.argv[1], Path(sys.argv[2]))
