"""world_editor.py SECONDS SEED: changes elements of a shared world model, then prints the scene.

A program with a replica. It prints `ready`; after a line of input it makes random changes for that time and prints how
many it made; after another line it prints the scene as it sees it, as one line of JSON.
"""

from __future__ import annotations

import json
import random
import sys
import time
from typing import Any

import rospy

from skiros2_common.core.world_element import Element
from skiros2_world_model.ros.world_model_interface import WmException, WorldModelInterface

KEYS = ("skiros:StateProperty", "skiros:ContainerState", "skiros:CadModel")
RELATIONS = ("skiros:contain", "skiros:hasA", "skiros:at")
SCENE = "skiros:Scene-0"


def scene_of(wmi: Any) -> dict[str, Any]:
    """The whole scene, in an order that depends on nothing but its content."""
    return {
        e.id: [
            e.type,
            e.label,
            sorted((p.key, p.dataType().__name__, p.values) for p in e.properties),
            sorted((r["src"], r["type"], r["dst"]) for r in e.getRelations()),
        ]
        for e in sorted(wmi.resolve_elements(Element()), key=lambda e: str(e.id))
    }


def change(wmi: Any, chance: random.Random) -> None:
    """One random change of an element that others may change, or remove, at the same time."""
    known = [e for e in wmi.resolve_elements(Element("sumo:Object")) if e.id != SCENE]
    kind = chance.choice(("add", "set", "set", "set", "unset", "relate", "relate", "unrelate", "whole", "remove"))
    if kind == "add" or len(known) < 10:
        element = Element("skiros:Part", "part")
        element.addRelation(SCENE, "skiros:contain", "-1")
        wmi.add_element(element)
        return
    element, second = chance.choice(known), chance.choice(known)
    if kind == "set":
        element.setProperty(chance.choice(KEYS), str(chance.random()))
        wmi.update_element(element)
    elif kind == "unset":
        element.removeProperty(chance.choice(KEYS))
        wmi.update_element_properties(element)
    elif kind == "whole":
        whole = Element(element.type, element.label, element.id)
        whole.setProperty(chance.choice(KEYS), "whole")
        whole.addRelation(SCENE, "skiros:contain", "-1")
        wmi.update_element(whole)
    elif kind == "remove":
        if len(known) > 30:
            wmi.remove_element(element)
    else:
        wmi.set_relation(element.id, chance.choice(RELATIONS), second.id, kind == "relate")


def main(seconds: float, seed: int) -> None:
    rospy.init_node("editor", anonymous=True, disable_signals=True)
    wmi = WorldModelInterface(rospy.get_name(), make_cache=True)
    chance = random.Random(seed)
    wmi.get_scene_elements()
    print("ready", flush=True)
    sys.stdin.readline()
    made = refused = 0
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        try:
            change(wmi, chance)
            made += 1
        except WmException:  # the other was faster, or the scene would contain itself
            refused += 1
    print(json.dumps({"made": made, "refused": refused}), flush=True)
    sys.stdin.readline()
    wmi.catch_up()
    print(json.dumps(scene_of(wmi)), flush=True)
    rospy.signal_shutdown("done")


if __name__ == "__main__":
    main(float(sys.argv[1]), int(sys.argv[2]))
