"""Tools: logging functions, numbers in use, stop-watches, decorators."""

import logging

import pytest

from skiros2_common.core.utils import ontology_type2name, ontology_type2name_dict
from skiros2_common.tools import logger as log
from skiros2_common.tools.decorators import PrettyObject, prevent
from skiros2_common.tools.id_generator import IdGen
from skiros2_common.tools.time_keeper import TimeKeeper, TimeKeepers, Timer


@pytest.fixture
def at_trace():
    before = log.getLevel()
    log.setLevel(log.TRACE)
    yield
    log.setLevel(before)


def messages(caplog):
    return [r.getMessage() for r in caplog.records if r.name == "skiros2"]


@pytest.mark.parametrize("name", ["always", "error", "warn", "ok", "info", "debug", "trace"])
def test_one_argument_is_the_text_and_two_are_origin_and_text(name, caplog, at_trace):
    getattr(log, name)("text")
    getattr(log, name)("origin", "text")
    assert messages(caplog) == ["text", "origin               text"]
    assert {r.levelname for r in caplog.records if r.name == "skiros2"} <= {
        "ALWAYS",
        "ERROR",
        "WARNING",
        "OK",
        "INFO",
        "DEBUG",
        "TRACE",
    }


@pytest.mark.parametrize("name", ["assertError", "assertWarn", "assertOk", "assertInfo"])
def test_the_assert_functions_log_failures_or_successes(name, caplog, at_trace):
    is_failure = name in ("assertError", "assertWarn")
    assert getattr(log, name)(False, "failed") is (not is_failure)
    assert getattr(log, name)(True, "holds") is is_failure
    assert messages(caplog) == ["failed" if is_failure else "holds"]


def test_a_level_drops_what_is_below(caplog, at_trace):
    log.setLevel(log.ERROR)
    log.warn("dropped")
    log.error("kept")
    assert messages(caplog) == ["kept"]
    assert log.getLevel() == log.ERROR


def test_numbers_are_unique_while_in_use():
    ids = IdGen()
    assert [ids.getId(), ids.getId(), ids.getId(5), ids.getId(5)] == [0, 1, 5, 6]
    ids.removeId(1)
    assert not ids.hasId(1)
    assert [ids.getId(), ids.getId()] == [1, 2]
    ids.clear()
    assert ids.getId() == 0


def test_pretty_objects_are_their_class_name():
    class Thing(PrettyObject):
        pass

    assert str(Thing()) == Thing().class_name == "Thing"


def test_prevent_keeps_a_method_from_being_called_while_attributes_have_values():
    class Door:
        locked = True

        @prevent(locked=True)
        def open(self):
            return "open"

    door = Door()
    assert door.open() is None
    door.locked = False
    assert door.open() == "open"


def test_time_keepers_average():
    keeper = TimeKeeper()
    assert keeper.toc() == 0.0
    assert keeper.get_avg_time() is None
    keeper.tic()
    first = keeper.toc()
    keeper.tic()
    second = keeper.toc()
    assert keeper.get_last() == second
    assert keeper.get_avg_time() == pytest.approx((first + second) / 2)
    keepers = TimeKeepers()
    keepers["tick"].tic()
    keepers["tick"].toc()
    assert keepers.printAvgTimings().startswith("tick: ")


def test_a_timer_logs_what_passed(caplog):
    caplog.set_level(logging.INFO)
    timer = Timer("load")
    timer.tic("ontology")
    assert timer.toc("ontology") >= 0.0
    assert "[load] ontology" in caplog.text


def test_names_of_ontology_types():
    assert ontology_type2name("skiros:LargeBox") == "skiros_LargeBox"
    assert ontology_type2name_dict("skiros:LargeBox") == {"prefix": "skiros", "name": "LargeBox"}
