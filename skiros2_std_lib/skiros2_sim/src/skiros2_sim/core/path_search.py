"""Searches a collision-free path of joint positions, with RRT-Connect of OMPL (Kuffner and LaValle, RRT-Connect: An
Efficient Approach to Single-Query Path Planning, 2000), and shortens it.

OMPL's searches are calls that last. They run in a thread of their own, but in lockstep with the caller: the caller
lets it make a number of collision checks and waits meanwhile. So a search holds up no step of the physics, and the
same seed gives the same path after the same number of pieces, on each machine. OMPL's random numbers are seeded for the
whole process: only one search at a time is reproducible.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt
from ompl import base, geometric, util

from skiros2_common.core.errors import Refused
from skiros2_motion.core.motion import Pieces

Array = npt.NDArray[np.float64]
T = TypeVar("T")

#: Distance between checked positions along a path (rad or m, norm over all joints).
RESOLUTION = 0.03
#: Number of collision checks in a piece: 1.5 to 2.5 ms.
CHECKS = 10
#: Maximum length of a branch of the search tree (rad).
_RANGE = 1.0


class _Closed(Exception):
    """The caller does not continue the search."""


def in_pieces(work: Callable[[Callable[[], None]], T]) -> Pieces[T]:
    """Runs a function in a thread of its own, in lockstep: the function runs only while the caller waits for a piece.

    :param work: called with a function that ends a piece; it may raise, to end a search that is not continued.
    :returns: the result of the function; its exceptions propagate.
    """
    proceed, paused = threading.Semaphore(0), threading.Semaphore(0)
    closed = False
    results: list[T] = []
    errors: list[Exception] = []

    def pause() -> None:
        paused.release()
        proceed.acquire()
        if closed:
            raise _Closed

    def run() -> None:
        proceed.acquire()
        try:
            if not closed:
                results.append(work(pause))
        except Exception as error:  # given to the caller
            errors.append(error)
        paused.release()

    thread = threading.Thread(target=run, name="path search", daemon=True)
    thread.start()
    try:
        while True:
            proceed.release()
            paused.acquire()
            if results or errors:
                break
            yield
    finally:
        closed = True
        proceed.release()
        thread.join()
    if errors:
        raise errors[0]
    return results[0]


def search_path(
    is_free: Callable[[Array], bool],
    lower: Array,
    upper: Array,
    start: Array,
    goals: Sequence[Array],
    seed: int,
    most_pieces: int,
) -> Pieces[list[Array]]:
    """Searches a path from `start` to one of `goals`, in pieces of `CHECKS` checks.

    :param is_free: whether joint positions (rad or m) are free of collisions.
    :param lower: joint limits; start and goals are within them and free.
    :param most_pieces: after these, the search ends without result.
    :returns: the corners of the path, from the start to a goal.
    :raises Refused: there is no path, or the search has not found it.
    """
    return in_pieces(lambda pause: _search(is_free, lower, upper, start, goals, seed, most_pieces, pause))


def _search(
    is_free: Callable[[Array], bool],
    lower: Array,
    upper: Array,
    start: Array,
    goals: Sequence[Array],
    seed: int,
    most_pieces: int,
    pause: Callable[[], None],
) -> list[Array]:
    count = len(start)
    checks = 0

    def is_valid(state: Any) -> bool:
        nonlocal checks
        checks += 1
        if checks % CHECKS == 0:
            pause()
        return is_free(np.array([state[i] for i in range(count)]))

    space = base.RealVectorStateSpace(count)
    bounds = base.RealVectorBounds(count)
    for i in range(count):
        bounds.setLow(i, float(lower[i]))
        bounds.setHigh(i, float(upper[i]))
    space.setBounds(bounds)
    information = base.SpaceInformation(space)
    information.setStateValidityChecker(is_valid)
    information.setStateValidityCheckingResolution(RESOLUTION / space.getMaximumExtent())
    information.setup()

    def state_of(positions: Array) -> Any:
        state = space.allocState()
        for i in range(count):
            state[i] = float(positions[i])
        return state

    problem = base.ProblemDefinition(information)
    problem.addStartState(state_of(start))
    ends = base.GoalStates(information)
    for goal in goals:
        ends.addState(state_of(goal))
    problem.setGoal(ends)
    util.setLogLevel(util.LOG_NONE)  # it reports each seed but the first one as an error
    util.RNG.setSeed(seed + 1)  # 0 is not a seed
    simplifier = geometric.PathSimplifier(information)
    planner = geometric.RRTConnect(information)
    planner.setRange(_RANGE)
    planner.setProblemDefinition(problem)
    planner.setup()
    is_over = base.PlannerTerminationCondition(lambda: checks >= most_pieces * CHECKS)
    if not planner.solve(is_over) or problem.hasApproximateSolution():
        raise Refused(f"no collision-free path was found with {checks} collision checks")
    path = problem.getSolutionPath()
    simplifier.reduceVertices(path)
    simplifier.partialShortcutPath(path)
    simplifier.collapseCloseVertices(path)
    return [np.array([state[i] for i in range(count)]) for state in path.getStates()]
