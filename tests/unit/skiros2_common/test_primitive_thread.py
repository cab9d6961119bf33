"""Primitives with a thread: progress and result."""

import threading

import pytest

from skiros2_common.core.abstract_skill import SkillDescription, State
from skiros2_common.core.primitive_thread import PrimitiveThreadBase


class Dig(SkillDescription):
    pass


class dig(PrimitiveThreadBase):
    """Waits for the result that `run` returns, or the exception that it raises."""

    willing = True

    def createDescription(self):
        self.setDescription(Dig(), "dig")
        self.go_on = threading.Event()
        self.woken = threading.Event()
        self.request_tick = self.woken.set

    def preStart(self):
        self.status = "takes the spade"
        return self.willing

    def run(self):
        self.status = "digs"
        assert self.go_on.wait(10)
        if isinstance(self.answer, Exception):
            raise self.answer
        return self.answer(self) if callable(self.answer) else self.answer


@pytest.fixture
def skill():
    made = dig()
    made.init(None)
    yield made
    made.go_on.set()


def end(skill, answer):
    """The state once `run` has answered so."""
    skill.answer = answer
    skill.woken.clear()
    skill.go_on.set()
    assert skill.woken.wait(10)
    return skill.tick()


def test_thread_primitive_reports_its_status_until_the_thread_ends(skill):
    assert skill.start()
    while skill.progress_msg != "digs":
        assert skill.tick() is State.Running
    code = skill.progress_code
    assert end(skill, lambda self: self.success("found a bone")) is State.Success
    assert skill.progress_msg == "found a bone"
    assert skill.progress_code >= code
    assert skill.tick() is State.Success  # and stays so


def test_failure_has_the_message_and_code_of_run(skill):
    skill.start()
    assert end(skill, lambda self: self.fail("a rock", 7)) is State.Failure
    assert (skill.progress_msg, skill.progress_code) == ("a rock", -7)


def test_exception_in_run_is_a_failure_with_its_text(skill):
    skill.start()
    assert end(skill, RuntimeError("the spade broke")) is State.Failure
    assert "RuntimeError: the spade broke" in skill.progress_msg
    assert skill.progress_code == -405


@pytest.mark.parametrize("answer", [None, State.Running, State.Idle, 7, "done"])
def test_result_of_run_that_is_not_final_is_a_failure(skill, answer):
    skill.start()
    assert end(skill, answer) is State.Failure
    assert f"dig.run returned {answer!r}, expected success(...) or fail(...)" in skill.progress_msg


@pytest.mark.parametrize(("answer", "state"), [(State.Success, State.Success), (State.Failure, State.Failure)])
def test_run_may_return_a_bare_state(skill, answer, state):
    skill.start()
    assert end(skill, answer) is state


def test_pre_start_that_returns_false_prevents_the_thread(skill):
    skill.willing = False
    before = threading.active_count()
    assert skill.start() is State.Failure
    assert threading.active_count() == before
    assert skill.state is State.Failure


def test_thread_primitive_can_start_again_after_its_end(skill):
    for answer in (State.Failure, State.Success):
        skill.go_on.clear()
        assert skill.start()
        assert end(skill, answer) is answer
        skill.reset()


def test_thread_primitive_does_not_start_while_its_thread_runs(skill):
    """Used by hand; in a task another instance is taken."""
    skill.start()
    assert skill.preempt() is State.Failure
    assert skill.start() is State.Failure
    assert skill.progress_msg == "the thread of an earlier start is still running"
    assert not hasattr(skill, "answer")
