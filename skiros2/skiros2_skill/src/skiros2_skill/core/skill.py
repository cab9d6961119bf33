"""The public names for skill libraries: compounds, nodes and processors."""

from skiros2_common.core.abstract_skill import ParamOptions, SkillCore, SkillDescription, State
from skiros2_common.core.params import ParamTypes
from skiros2_common.core.world_element import Element
from skiros2_skill.core.engine.hooks import SkillPreempted
from skiros2_skill.core.processors import (
    Loop,
    NoFail,
    NoProcessor,
    ParallelFf,
    ParallelFs,
    RetryOnFail,
    Selector,
    SelectorStar,
    Sequential,
    Serial,
    SerialStar,
)
from skiros2_skill.core.tree.compound import SkillBase
from skiros2_skill.core.tree.node import ControlNode, Root, SkillInterface
from skiros2_skill.core.tree.skill_node import SkillWrapper

#: The name that libraries know.
Skill = ControlNode

__all__ = [
    "ControlNode",
    "Element",
    "Loop",
    "NoFail",
    "NoProcessor",
    "ParallelFf",
    "ParallelFs",
    "ParamOptions",
    "ParamTypes",
    "RetryOnFail",
    "Root",
    "Selector",
    "SelectorStar",
    "Sequential",
    "Serial",
    "SerialStar",
    "Skill",
    "SkillBase",
    "SkillCore",
    "SkillDescription",
    "SkillInterface",
    "SkillPreempted",
    "SkillWrapper",
    "State",
]
