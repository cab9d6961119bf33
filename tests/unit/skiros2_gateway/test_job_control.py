"""Job Control: methods, states, the queue, responses, and what a restart keeps."""

from __future__ import annotations

import asyncio
import itertools
from collections.abc import Callable
from typing import Any

import pytest

from skiros2_common.core.errors import Conflict, Refused, UnknownName
from skiros2_gateway.core import job_control
from skiros2_gateway.core.job import ALLOWED, FOLLOWING, Method, State, Substate, read_order
from skiros2_gateway.core.json_text import json_text
from skiros2_gateway.core.problems import Rejected
from skiros2_gateway.core.queue import move
from support.stand_in_cell import ROBOT

Run = Callable[..., None]


def test_job_runs_through_all_states(in_gateway: Run) -> None:
    async def test(gateway: Any) -> None:
        job = await gateway.put("a", start=False)
        assert gateway.state("a") == "NotAllowedToStart/Ready"
        assert not gateway.cell.sent
        gateway.control.apply(Method.START, "a", "mes")
        assert gateway.state("a") == "AllowedToStart/Loaded"
        await gateway.store.synced()
        assert [goal.id for goal in gateway.cell.sent] == ["a"]
        gateway.cell.accept("a")
        assert gateway.state("a") == "Running"
        gateway.now += 5.0
        gateway.cell.run("a")
        gateway.cell.end("a")
        assert gateway.state("a") == "Ended/Completed"
        job = await gateway.collected("a")
        assert gateway.state("a") == "Ended/Closed"
        assert (job.response.outcome, job.response.robots) == ("succeeded", [ROBOT])
        assert job.response.ended - job.response.started == 5.0
        assert [change["elements"] for change in job.response.changes] == [["Product-2"]]
        methods = [entry["method"] for entry in gateway.store.history("a")]
        assert methods == ["Store", "Start", "loaded", "accepted", "ended", "collected"]

    in_gateway(test)


def test_method_is_refused_in_states_that_do_not_allow_it(in_gateway: Run) -> None:
    async def test(gateway: Any) -> None:
        job = await gateway.put("a", start=False)
        for method, state in itertools.product(ALLOWED, State):
            job.state, job.substate = state, Substate.NONE
            if state in ALLOWED[method]:
                job.check(method)
            else:
                with pytest.raises(Refused, match=f"it is {state}"):
                    job.check(method)

    in_gateway(test)


def test_states_follow_as_in_the_table() -> None:
    ends = [state for state, following in FOLLOWING.items() if not following]
    assert ends == [State.ENDED, State.ABORTED]
    assert State.RUNNING not in FOLLOWING[State.NOT_ALLOWED_TO_START]
    assert [state.number for state in State] == [1, 2, 3, 4, 5, 6]


def test_highest_priority_then_earliest_due_time_starts_first(in_gateway: Run) -> None:
    async def test(gateway: Any) -> None:
        await gateway.put("first")
        await gateway.put("low", priority=-1)
        await gateway.put("later", priority=5, due="2030-01-02T00:00:00Z")
        await gateway.put("sooner", priority=5, due="2030-01-01T00:00:00Z")
        await gateway.put("plain")
        for expected in ("first", "sooner", "later", "plain", "low"):
            assert gateway.cell.sent[-1].id == expected
            gateway.cell.end(expected)
            await gateway.store.synced()

    in_gateway(test)


def test_urgent_job_does_not_wait_for_capacity(in_gateway: Run) -> None:
    async def test(gateway: Any) -> None:
        await gateway.put("running")
        await gateway.put("urgent", priority=100)
        assert [goal.id for goal in gateway.cell.sent] == ["running", "urgent"]

    in_gateway(test)


def test_job_waits_for_its_earliest_start(in_gateway: Run) -> None:
    async def test(gateway: Any) -> None:
        await gateway.put("a", earliest_start="1970-01-01T00:16:40.05Z")  # 50 ms after the gateway's clock
        assert gateway.state("a") == "AllowedToStart/Waiting"
        gateway.now += 1.0
        while not gateway.cell.sent:
            await asyncio.sleep(0.005)

    in_gateway(test)


def test_job_waits_until_the_cell_is_ready(in_gateway: Run) -> None:
    async def test(gateway: Any) -> None:
        gateway.cell.is_ready = False
        await gateway.put("a")
        assert gateway.state("a") == "AllowedToStart/Ready"
        gateway.cell.is_ready = True
        gateway.control.cell_changed()
        assert gateway.state("a") == "AllowedToStart/Loaded"

    in_gateway(test)


def test_job_starts_although_nobody_reports_that_the_cell_is_ready_again(
    in_gateway: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A status that was late at the moment of the order, and in time at the next look, is no change."""
    monkeypatch.setattr(job_control, "_RETRY", 0.01)

    async def test(gateway: Any) -> None:
        gateway.cell.is_ready = False
        await gateway.put("a")
        gateway.cell.is_ready = True
        async with asyncio.timeout(10.0):
            while not gateway.cell.sent:
                await asyncio.sleep(0.005)

    in_gateway(test)


def test_same_order_again_is_the_same_job(in_gateway: Run) -> None:
    async def test(gateway: Any) -> None:
        order = read_order({"id": "a", "goal": "(at robot home)"})
        assert (await gateway.control.put(order, "mes", start=True))[1]
        await gateway.store.synced()
        gateway.cell.end("a")
        job, is_new = await gateway.control.put(order, "mes", start=True)
        assert (job.state, is_new, len(gateway.cell.sent)) == (State.ENDED, False, 1)
        with pytest.raises(Conflict):
            await gateway.put("a", goal="(at robot elsewhere)")
        await gateway.collected("a")
        gateway.control.apply(Method.CLEAR, "a", "mes")
        assert not list(gateway.store.jobs())
        assert not (await gateway.control.put(order, "mes", start=True))[1], "a cleared job does not run again"

    in_gateway(test)


def test_same_order_twice_at_once_is_one_job(in_gateway: Run) -> None:
    async def test(gateway: Any) -> None:
        await asyncio.gather(*(gateway.put("a") for _ in range(10)))
        assert len(gateway.cell.sent) == 1

    in_gateway(test)


@pytest.mark.parametrize(("method", "state"), [(Method.STOP, State.ENDED), (Method.ABORT, State.ABORTED)])
def test_running_job_is_stopped_and_aborted(in_gateway: Run, method: Method, state: State) -> None:
    async def test(gateway: Any) -> None:
        await gateway.put("a")
        gateway.cell.accept("a")
        gateway.control.apply(method, "a", "mes")
        assert (gateway.cell.stopped, gateway.state("a")) == (["a"], "Running")
        with pytest.raises(Refused, match="is being carried out"):
            gateway.control.apply(Method.PAUSE, "a", "mes")
        gateway.cell.end("a", "cancelled")
        assert gateway.job("a").state is state

    in_gateway(test)


def test_paused_job_is_held_until_it_is_resumed(in_gateway: Run) -> None:
    async def test(gateway: Any) -> None:
        await gateway.put("a")
        gateway.cell.accept("a")
        gateway.control.apply(Method.PAUSE, "a", "mes")
        assert (gateway.state("a"), gateway.cell.paused) == ("Interrupted/Held", {"a"})
        gateway.control.apply(Method.RESUME, "a", "mes")
        assert (gateway.state("a"), gateway.cell.paused) == ("Running", set())

    in_gateway(test)


def test_stop_of_a_robot_suspends_its_job(in_gateway: Run) -> None:
    async def test(gateway: Any) -> None:
        await gateway.put("a")
        gateway.cell.accept("a")
        gateway.control.goal_suspended("a", "/robot: protective_stop (fence)")
        assert gateway.state("a") == "Interrupted/Suspended"
        gateway.control.goal_suspended("a", "")
        assert gateway.state("a") == "Running"

    in_gateway(test)


def test_waiting_job_is_updated_revoked_and_cancelled(in_gateway: Run) -> None:
    async def test(gateway: Any) -> None:
        gateway.cell.is_ready = False
        await gateway.put("a")
        await gateway.control.update(read_order({"id": "a", "goal": "(b)", "priority": 3}), "mes")
        assert (gateway.job("a").goal, gateway.job("a").order.priority) == ("(b)", 3)
        gateway.control.apply(Method.REVOKE_START, "a", "mes")
        assert gateway.state("a") == "NotAllowedToStart/Ready"
        gateway.control.apply(Method.CANCEL, "a", "mes")
        assert (gateway.state("a"), gateway.job("a").cleared) == ("Aborted", True)
        with pytest.raises(UnknownName, match="no job 'b'"):
            gateway.control.apply(Method.START, "b", "mes")

    in_gateway(test)


def test_work_master_is_filled_in_and_its_quality_data_are_read(in_gateway: Run) -> None:
    async def test(gateway: Any) -> None:
        gateway.cell.properties["Product-2", "skiros:Weight"] = 1.5
        await gateway.put("a", work_master="place", parameters={"Tray": "Tray-1"})
        assert gateway.cell.sent[0].text == '(skiros:contain "Tray-1" "Product-2")'
        gateway.cell.end("a")
        assert (await gateway.collected("a")).response.quality == {"Product.skiros:Weight": 1.5}

    in_gateway(test)


def test_order_is_rejected_with_all_problems_and_changes_nothing(in_gateway: Run) -> None:
    async def test(gateway: Any) -> None:
        with pytest.raises(Rejected) as rejected:
            await gateway.put("a", work_master="place", parameters={"Tra": 1, "Speed": 9.0, "Product": 'x" y'})
        codes = {(p.code, p.where) for p in rejected.value.problems}
        assert codes == {
            ("unknown_name", "parameters.Tra"), ("missing", "parameters.Tray"), ("out_of_limits", "parameters.Speed"),
            ("wrong_value", "parameters.Product"),
        }  # fmt: skip
        assert rejected.value.problems[0].nearest == ("Tray",)
        with pytest.raises(Rejected) as rejected:
            read_order({"id": "no id", "priority": 1e9, "colour": "red"})
        assert {p.where for p in rejected.value.problems} == {"id", "priority", "colour"}
        with pytest.raises(Rejected, match="/other"):
            await gateway.put("a", robots=["/other"])
        assert not list(gateway.store.jobs()) and not gateway.cell.sent

    in_gateway(test)


def test_plan_with_a_robot_that_is_not_allowed_aborts_the_job(in_gateway: Run) -> None:
    async def test(gateway: Any) -> None:
        await gateway.put("a", robots=[ROBOT])
        gateway.cell.run("a", "/other")
        assert gateway.cell.stopped == ["a"]
        gateway.cell.end("a", "cancelled")
        assert gateway.state("a") == "Aborted"
        assert "/other" in gateway.job("a").response.notes[0]

    in_gateway(test)


def test_restart_continues_the_queue_and_looks_for_running_goals(in_gateway: Run) -> None:
    async def test(gateway: Any) -> None:
        await gateway.put("running")
        await gateway.put("waiting")
        gateway.cell.accept("running")
        gateway.restart()
        assert (gateway.cell.followed, gateway.cell.sent) == (["running"], [])
        gateway.cell.end("running")
        await gateway.store.synced()
        assert [goal.id for goal in gateway.cell.sent] == ["waiting"]

    in_gateway(test)


def test_goal_that_was_sent_before_a_kill_is_not_sent_again(in_gateway: Run) -> None:
    async def test(gateway: Any) -> None:
        await gateway.put("a")
        assert gateway.state("a") == "AllowedToStart/Loaded"
        gateway.restart()
        assert (gateway.cell.followed, gateway.cell.sent) == (["a"], [])
        gateway.cell.end("a", "lost", "the task manager does not know it")
        assert gateway.state("a") == "Aborted"
        assert gateway.job("a").response.outcome == "lost"

    in_gateway(test)


def test_goal_that_never_reached_the_task_manager_is_sent_again(in_gateway: Run) -> None:
    async def test(gateway: Any) -> None:
        await gateway.put("a")
        gateway.restart()
        gateway.cell.end("a", "unknown", "the task manager does not know it")
        assert [goal.id for goal in gateway.cell.sent] == ["a"]
        gateway.cell.accept("a")
        gateway.cell.end("a", "unknown", "the task manager does not know it")
        assert len(gateway.cell.sent) == 1
        assert gateway.job("a").response.outcome == "lost"

    in_gateway(test)


def test_changes_are_collected_by_their_numbers_whatever_the_clock_does(
    in_gateway: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def test(gateway: Any) -> None:
        asked: list[tuple[float, float]] = []
        collect = gateway.cell.collect

        async def note(robots: Any, start: float, end: float, quality: Any) -> Any:
            asked.append((start, end))
            return await collect(robots, start, end, quality)

        monkeypatch.setattr(gateway.cell, "collect", note)
        for jump in (86400.0, -2 * 86400.0):
            name = f"a{jump}"
            gateway.cell.revision = 10
            await gateway.put(name)
            gateway.now += jump
            gateway.cell.revision = 17
            gateway.cell.end(name)
            await gateway.collected(name)
        assert asked == [(10, 17), (10, 17)]

    in_gateway(test)


def test_clock_that_is_set_forward_starts_a_waiting_job(in_gateway: Run) -> None:
    async def test(gateway: Any) -> None:
        await gateway.put("a", earliest_start="1970-01-02T00:16:40Z")  # in a day
        assert gateway.state("a") == "AllowedToStart/Waiting"
        gateway.now += 86400.0
        async with asyncio.timeout(5.0):
            while not gateway.cell.sent:
                await asyncio.sleep(0.01)

    in_gateway(test)


def test_response_that_was_not_collected_before_a_kill_is_collected_after(in_gateway: Run) -> None:
    async def test(gateway: Any) -> None:
        await gateway.put("a")
        gateway.cell.end("a")
        gateway.restart()
        assert (await gateway.collected("a")).response.changes

    in_gateway(test)


def test_paused_job_is_paused_again_after_a_restart(in_gateway: Run) -> None:
    async def test(gateway: Any) -> None:
        await gateway.put("a")
        gateway.cell.accept("a")
        gateway.control.apply(Method.PAUSE, "a", "mes")
        gateway.restart()
        assert gateway.cell.paused == {"a"}

    in_gateway(test)


def test_response_is_completed_although_the_cell_cannot_be_read(
    in_gateway: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def fail(*_: Any) -> Any:
        raise OSError("connection reset")

    async def test(gateway: Any) -> None:
        await gateway.put("a")
        monkeypatch.setattr(gateway.cell, "collect", fail)
        gateway.cell.end("a")
        job = await gateway.collected("a")
        assert (gateway.state("a"), job.response.notes) == (
            "Ended/Closed", ["the changes are unknown: connection reset"]
        )  # fmt: skip

    in_gateway(test)


def test_texts_and_the_queue_of_open_jobs_follow_each_change(in_gateway: Run) -> None:
    async def test(gateway: Any) -> None:
        def check() -> None:
            jobs = gateway.control.open_jobs
            assert gateway.control.jobs.texts() == [json_text(job.to_dict()) for job in jobs]
            assert len(gateway.control.jobs) == len(jobs)

        await gateway.put("a")
        await gateway.put("b", start=False)
        await gateway.put("c", priority=3)
        check()
        for goal in ("a", "c"):
            gateway.cell.run(goal)
            check()
            gateway.restart()
            gateway.cell.end(goal)
            await gateway.collected(goal)
            check()
        for method in (Method.START, Method.ABORT):
            gateway.control.apply(method, "b", "test")
            check()

    in_gateway(test)


def test_moved_jobs_start_in_the_order_shown_also_after_a_restart(in_gateway: Run) -> None:
    async def test(gateway: Any) -> None:
        control = gateway.control
        for job_id, priority in (("running", 0), ("a", 5), ("b", 0), ("c", 0), ("d", 0)):
            await gateway.put(job_id, priority=priority)

        def order() -> list[str]:
            return [job.id for job in gateway.control.open_jobs][1:]

        assert order() == ["a", "b", "c", "d"]
        for job_id, before, expected in (
            ("d", "b", "adbc"), ("c", "d", "acdb"), ("b", "d", "acbd"), ("b", "c", "abcd"), ("c", "a", "cabd"),
            ("b", "c", "bcad"), ("b", "", "cadb"), ("a", "", "cdba"), ("d", "a", "cbda"),
        ):  # fmt: skip
            move(control, job_id, before, "test")
            assert order() == list(expected), f"{job_id} before {before}"
        await gateway.put("e")
        assert order() == ["c", "b", "d", "a", "e"]
        gateway.restart()
        assert order() == ["c", "b", "d", "a", "e"]
        started = []
        for _ in range(6):
            job = gateway.control.open_jobs[0]
            started.append(job.id)
            gateway.cell.run(job.id)
            gateway.cell.end(job.id, "succeeded")
        assert started == ["running", "c", "b", "d", "a", "e"]

    in_gateway(test)


def test_only_queued_jobs_move_and_none_before_one_that_interrupts(in_gateway: Run) -> None:
    async def test(gateway: Any) -> None:
        control = gateway.control
        await gateway.put("running")
        await gateway.put("stored", start=False)
        for job_id in ("a", "b"):
            await gateway.put(job_id)
        for job_id, before in (("running", "a"), ("a", "running"), ("stored", "a"), ("a", "stored")):
            with pytest.raises(Refused, match="is not in the queue"):
                move(control, job_id, before, "test")
        with pytest.raises(UnknownName):
            move(control, "missing", "a", "test")
        gateway.cell.interrupt_priority = 1
        await gateway.put("urgent", priority=1, earliest_start="2100-01-01T00:00:00Z")
        with pytest.raises(Refused, match="interrupts others"):
            move(control, "b", "urgent", "test")
        move(control, "b", "a", "test")
        assert [job.id for job in control.open_jobs] == ["running", "urgent", "b", "a", "stored"]

    in_gateway(test)
