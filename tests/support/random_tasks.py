"""Planning tasks and plans made at random, for properties that hold of all: `drawn = data.draw(planned_tasks())`."""

from __future__ import annotations

from hypothesis import strategies as st

from skiros2_task.core.actions import Action, Effect, Variable
from skiros2_task.core.formula import Atom, Exists, ForAll, Formula, Kind, Not, Predicate, conjunction, disjunction
from skiros2_task.core.skills import Skill
from skiros2_task.core.task import EVERYTHING, PlanningTask, PlanStep

ROBOT, THING = "cora:Robot", "skiros:Product"
ROBOTS, THINGS = ("robot-0", "robot-1", "robot-2"), ("thing-0", "thing-1")
FACTS = tuple(Predicate(Kind.VALUE, f"skiros:P{i}", True) for i in range(3))
READY = Predicate(Kind.VALUE, "skiros:Ready", True)

_ONE, _OTHER = "?One", "?Other"


def _atoms(*terms: str) -> st.SearchStrategy[Atom]:
    facts = st.builds(lambda p, t: Atom(p, (t,)), st.sampled_from(FACTS), st.sampled_from(terms))
    return st.one_of(facts, st.just(Atom(READY, ("?Robot",))))


def _formulas() -> st.SearchStrategy[Formula]:
    literal = st.one_of(_atoms(_ONE, _OTHER), _atoms(_ONE, _OTHER).map(Not))
    some = st.lists(literal, min_size=1, max_size=3).map(disjunction)
    quantified = st.builds(
        lambda kind, body: kind((("?each", THING),), body),
        st.sampled_from((ForAll, Exists)),
        st.builds(lambda p, state: p if state else Not(p), _atoms("?each"), st.booleans()),
    )
    return st.lists(st.one_of(literal, some, quantified), max_size=2).map(conjunction)


def _effects() -> st.SearchStrategy[tuple[Effect, ...]]:
    plain = st.builds(Effect, _atoms(_ONE, _OTHER), st.booleans())
    for_each = st.builds(lambda a, state: Effect(a, state, (("?each", THING),)), _atoms("?each"), st.booleans())
    return st.lists(st.one_of(plain, plain, for_each), min_size=1, max_size=3).map(tuple)


#: Built once: building a strategy takes longer than drawing from it.
_FORMULAS, _EFFECTS, _FACT = _formulas(), _effects(), st.sampled_from(FACTS)


@st.composite
def _actions(draw: st.DrawFn, name: str) -> Action:
    needed = [draw(_FORMULAS)]
    during: tuple[Effect, ...] = ()
    if draw(st.booleans()):  # it locks something: that is free when it starts, and taken while it runs
        lock = Atom(draw(_FACT), (_ONE,))
        needed.append(lock)
        during = (Effect(lock, False),)
    can = Atom(Predicate(Kind.CAN, name), ("?Robot",))
    return Action(
        name,
        Skill(f"skiros:{name.capitalize()}", name, (), (), (), ()),
        "?Robot",
        tuple((robot, f"/{robot}") for robot in ROBOTS),
        (Variable("?Robot", "Robot", (ROBOT,)), Variable(_ONE, "One", (THING,)), Variable(_OTHER, "Other", (THING,))),
        conjunction([can, *needed]),
        draw(_EFFECTS),
        during,
    )


@st.composite
def planned_tasks(draw: st.DrawFn, most: int = 6) -> tuple[PlanningTask, tuple[PlanStep, ...]]:
    """A task and a plan that works: steps that can be done one after the other, and facts that hold in the end.

    :param most: how many steps.
    """
    actions = tuple(draw(_actions(name)) for name in ("a", "b", "c"))
    facts = [Atom(p, (t,)) for p in FACTS for t in THINGS] + [Atom(READY, (r,)) for r in ROBOTS]
    can = [Atom(Predicate(Kind.CAN, a.name), (r,)) for a in actions for r in ROBOTS]
    init = frozenset([*draw(st.lists(st.sampled_from(facts), unique=True)), *can])
    members = {ROBOT: ROBOTS, THING: THINGS, EVERYTHING: ROBOTS + THINGS}
    objects = {**dict.fromkeys(ROBOTS, ROBOT), **dict.fromkeys(THINGS, THING)}
    task = PlanningTask(actions, objects, members, (*FACTS, READY), init, conjunction([]))
    steps = [PlanStep(a.name, (r, x, y)) for a in actions for r in ROBOTS for x in THINGS for y in THINGS]
    every = [(step, task.ground(step)) for step in steps]
    state, plan = init, []
    for _ in range(draw(st.integers(0, most))):
        possible = [step for step, ground in every if ground.can_start(state)]
        if not possible:
            break
        plan.append(draw(st.sampled_from(possible)))
        state = task.ground(plan[-1]).apply(state)
    wanted = draw(st.lists(st.sampled_from(facts), unique=True, max_size=4))
    goal = conjunction(atom if atom in state else Not(atom) for atom in wanted)
    return PlanningTask(actions, objects, members, (*FACTS, READY), init, goal), tuple(plan)
