"""How a goal is carried out: with robots that fail and disappear, and a world that others change."""

from __future__ import annotations

from hypothesis import given, settings
from hypothesis import strategies as st

from skiros2_task.core.commands import JobState, Phase
from skiros2_task.core.execution import PATIENCE
from skiros2_task.core.jobs import Job
from skiros2_task.core.task_planner import Verdict
from support.transport_cell import PLANNING_TIME, STEP_TIME, TransportCell


def states(cell: TransportCell) -> list[tuple[str, JobState]]:
    return [(r.job.call.label, r.state) for r in cell.executive.records.values()]


def test_a_plan_is_carried_out_and_the_goal_is_looked_at() -> None:
    cell = TransportCell(1, 2, 1)
    cell.run()
    assert cell.end is not None
    assert (cell.end.verdict, cell.end.message) == (Verdict.PLANNED, "the goal is reached")
    assert cell.reached
    done = JobState.SUCCEEDED
    assert states(cell) == [("pick", done), ("drive", done), ("place", done)]
    assert cell.executive.replans == 0


def test_robots_work_side_by_side_where_the_order_allows() -> None:
    one, two = TransportCell(1, 4, 4), TransportCell(2, 4, 4)
    one.run()
    two.run()
    assert one.reached
    assert two.reached
    assert two.now < 0.7 * one.now


def test_a_goal_that_holds_needs_nothing() -> None:
    cell = TransportCell(1, 1, 1)  # the place after the only one is itself
    cell.run()
    assert cell.end is not None
    assert (cell.end.verdict, cell.end.message) == (Verdict.NOTHING_TO_DO, "the goal holds already")


def test_what_fails_is_planned_anew() -> None:
    failed: list[Job] = []

    def first_place(job: Job) -> bool:
        if job.call.label != "place" or failed:
            return False
        failed.append(job)
        return True

    cell = TransportCell(1, 2, 1, fails=first_place)
    cell.run()
    assert cell.reached
    assert cell.executive.replans == 1
    assert [state for _, state in states(cell)].count(JobState.FAILED) == 1


def test_a_skill_that_fails_again_is_left_to_another_robot() -> None:
    cell = TransportCell(2, 2, 1, fails=lambda job: job.call.manager == "cora:Robot-0" and job.call.label == "pick")
    cell.run()
    assert cell.reached
    assert cell.executive.replans == 2


def test_what_fails_while_it_is_planned_anew_is_not_counted_on() -> None:
    failed: list[Job] = []

    def first_two(job: Job) -> bool:
        failed.append(job)
        return len(failed) <= 2

    cell = TransportCell(2, 4, 4, fails=first_two)
    cell.run()
    assert {job.call.manager for job in failed[:2]} == set(cell.robots), "both robots failed at the same time"
    assert cell.reached
    assert cell.executive.replans == 2
    assert all(fits for _, fits in cell.started)


def test_what_always_fails_ends_after_so_many_plans() -> None:
    cell = TransportCell(1, 2, 1, max_replans=3, fails=lambda job: job.call.label == "pick")
    cell.run()
    assert cell.end is not None
    assert cell.end.verdict is Verdict.FAILED
    assert cell.end.message.endswith("has failed: broken after it was planned anew 3 times")
    assert len(cell.started) == 4


def test_what_runs_and_is_needed_goes_on_while_the_rest_is_planned_anew() -> None:
    cell = TransportCell(2, 4, 2, fails=lambda job: job.number == 1)
    cell.run(until=PLANNING_TIME + STEP_TIME / 2)
    other = next(d.job for d in cell.doing.values() if d.job.call.manager == "cora:Robot-1")
    cell.doing[other.number].until += STEP_TIME  # it takes long
    cell.run(until=PLANNING_TIME + STEP_TIME * 1.9)
    assert cell.executive.replans == 1
    assert other.number in cell.doing
    cell.run()
    assert cell.reached
    assert cell.executive.records[other.number].state is JobState.SUCCEEDED


def test_a_world_that_others_change_is_seen_before_a_step_fails_on_it() -> None:
    cell = TransportCell(1, 3, 2)
    cell.run(until=PLANNING_TIME + 1.0)
    product = cell.task.members["skiros:Product"][1]
    cell.move(product, cell.task.members["skiros:Location"][2])  # which is where it is to be
    cell.run()
    assert cell.reached
    assert cell.executive.replans == 1
    assert all(fits for _, fits in cell.started)


def test_what_is_put_right_at_once_breaks_nothing() -> None:
    cell = TransportCell(1, 3, 2)
    cell.run(until=PLANNING_TIME + 1.0)
    before, product = cell.facts, cell.task.members["skiros:Product"][1]
    cell.move(product, cell.task.members["skiros:Location"][2])
    cell.run(until=PLANNING_TIME + 1.1)
    cell.change(before)
    cell.run()
    assert cell.reached
    assert cell.executive.replans == 0


def test_what_runs_and_is_not_needed_any_more_is_stopped() -> None:
    cell = TransportCell(2, 3, 2)
    cell.run(until=PLANNING_TIME + 0.1)
    assert {d.job.call.label for d in cell.doing.values()} == {"pick", "drive"}
    product = cell.task.members["skiros:Product"][1]
    cell.move(product, cell.task.members["skiros:Location"][2])
    cell.run()
    assert cell.reached
    assert ("drive", JobState.STOPPED) in states(cell)


def test_the_work_of_a_robot_that_disappears_is_given_to_others() -> None:
    cell = TransportCell(2, 4, 4)
    cell.run(until=PLANNING_TIME + 0.5)
    cell.lose("cora:Robot-1")  # it was on its way
    cell.run()
    assert cell.reached
    assert any(state is JobState.FAILED for _, state in states(cell))


def test_a_robot_without_which_there_is_no_plan_is_waited_for() -> None:
    cell = TransportCell(1, 2, 1)
    cell.run(until=PLANNING_TIME + STEP_TIME + 0.5)
    cell.lose("cora:Robot-0")
    cell.run(until=cell.now + PLANNING_TIME + 1.0)
    assert cell.executive.phase is Phase.BLOCKED
    cell.find("cora:Robot-0")
    cell.run()
    assert cell.reached


def test_a_robot_that_does_not_come_back_is_not_waited_for_for_ever() -> None:
    cell = TransportCell(1, 2, 1)
    cell.run(until=PLANNING_TIME + STEP_TIME + 0.5)
    cell.lose("cora:Robot-0")
    lost_at = cell.now
    cell.run()
    assert cell.end is not None
    assert cell.end.verdict is Verdict.IMPOSSIBLE
    assert PATIENCE <= cell.now - lost_at < PATIENCE + 5


def test_a_goal_is_cancelled_in_each_phase() -> None:
    for moment in (0.1, PLANNING_TIME + 1.0, PLANNING_TIME + 3 * STEP_TIME):
        cell = TransportCell(1, 2, 1)
        cell.run(until=moment)
        cell.tell(cell.executive.cancel())
        cell.run()
        assert cell.end is not None
        if cell.end.verdict is not Verdict.CANCELLED:
            assert cell.reached


# -- at random -----------------------------------------------------------------------------------------------------

SIZES = st.tuples(st.integers(1, 3), st.integers(2, 4), st.integers(1, 4))


@given(size=SIZES, failing=st.sets(st.integers(1, 40), max_size=5))
@settings(max_examples=200, deadline=None)
def test_failures_that_are_not_more_than_plans_do_not_keep_it_from_the_goal(
    size: tuple[int, int, int], failing: set[int]
) -> None:
    cell = TransportCell(*size, max_replans=5, fails=lambda job: job.number in failing)
    cell.run()
    assert cell.reached
    assert cell.executive.replans <= len(failing)
    assert cell.plans == 1 + cell.executive.replans
    assert all(fits for _, fits in cell.started), "each step was started where what it needs held"


EVENTS = st.lists(
    st.tuples(
        st.sampled_from(["move", "lose", "find", "cancel"]), st.floats(0.05, 6.0), st.integers(0, 3), st.integers(0, 3)
    ),
    max_size=6,
)


@given(size=SIZES, failing=st.sets(st.integers(1, 40), max_size=5), events=EVENTS, max_replans=st.integers(0, 4))
@settings(max_examples=300, deadline=None)
def test_whatever_happens_it_ends_and_tells_the_truth(
    size: tuple[int, int, int], failing: set[int], events: list[tuple[str, float, int, int]], max_replans: int
) -> None:
    cell = TransportCell(*size, max_replans=max_replans, fails=lambda job: job.number in failing)
    robots, places, products = cell.robots, cell.task.members["skiros:Location"], cell.task.members["skiros:Product"]
    for kind, wait, one, other in events:
        cell.run(until=cell.now + wait)
        if cell.end is not None:
            break
        if kind == "move":
            cell.move(products[one % len(products)], places[other % len(places)])
        elif kind == "lose":
            cell.lose(robots[one % len(robots)])
        elif kind == "find":
            cell.find(robots[one % len(robots)])
        else:
            cell.tell(cell.executive.cancel())
    cell.run()
    assert cell.end is not None
    assert not cell.doing
    assert cell.executive.replans <= max_replans
    if cell.end.verdict in (Verdict.PLANNED, Verdict.NOTHING_TO_DO):
        assert cell.reached
    for record in cell.executive.records.values():
        assert record.state not in (JobState.WAITING, JobState.RUNNING)
        assert (record.began is None) == (record.state is JobState.DROPPED)
