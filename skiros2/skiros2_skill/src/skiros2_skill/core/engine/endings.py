"""Ends of trees that do not come by themselves."""

from __future__ import annotations

import logging

from skiros2_common.core.abstract_skill import State
from skiros2_common.core.explanation import PREEMPT
from skiros2_skill.core.engine.executor import Executor
from skiros2_skill.core.engine.failures import PREEMPT_RAISED, Failure
from skiros2_skill.core.tree.hook_guard import LeftBehind, Stuck
from skiros2_skill.core.tree.node import SkillInterface, all_nodes
from skiros2_skill.core.tree.skill_node import SkillWrapper

log = logging.getLogger(__name__)


def preempt_all(executor: Executor, root: SkillInterface) -> None:
    """Preempts all that runs in a tree, also where nodes with code of their own raise."""
    try:
        executor.preempt(root)
    except LeftBehind:
        raise
    except Exception:
        log.exception("%s: a node could not be preempted", root.printState())
        for node in reversed(list(all_nodes(root))):
            if isinstance(node, SkillWrapper) and node.hasState(State.Running):
                executor.preempt(node)


def bury(executor: Executor, stuck: Stuck) -> None:
    """Ends the node whose hook was left behind, without its other hooks; its instance is used no more."""
    node = stuck.node
    if node in executor.ending:
        executor.ending.remove(node)
    node.retire()
    node._setProgress(stuck.reason, PREEMPT_RAISED)
    executor.failures.note(node, Failure(PREEMPT, PREEMPT_RAISED, stuck.reason))
    executor.set_state(node, State.Failure)
    for child in node.children:
        if child.hasState(State.Running):
            child.visitPreempt(executor)
    executor.free(node)


def give_up(executor: Executor) -> None:
    """Ends the nodes that were preempted and still go on; their instances are used no more."""
    for node in list(executor.ending):
        executor.ending.remove(node)
        text = "did not end in time after its preemption"
        node.getInstance()._setProgress(text, PREEMPT_RAISED)
        executor.failures.note(node, Failure(PREEMPT, PREEMPT_RAISED, text))
        node.abandoned = True
        executor.end(node, State.Failure, preempted=True)
