"""Tools: logging functions, ids, stopwatches, decorators."""

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
def test_log_takes_a_text_or_a_name_and_a_text(name, caplog, at_trace):
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
def test_assert_functions_log_by_their_condition(name, caplog, at_trace):
    is_failure = name in ("assertError", "assertWarn")
    assert getattr(log, name)(False, "failed") is (not is_failure)
    assert getattr(log, name)(True, "holds") is is_failure
    assert messages(caplog) == ["failed" if is_failure else "holds"]


def test_level_discards_less_severe_messages(caplog, at_trace):
    log.setLevel(log.ERROR)
    log.warn("dropped")
    log.error("kept")
    assert messages(caplog) == ["kept"]
    assert log.getLevel() == log.ERROR


def test_ids_are_unique_while_in_use():
    ids = IdGen()
    assert [ids.getId(), ids.getId(), ids.getId(5), ids.getId(5)] == [0, 1, 5, 6]
    ids.removeId(1)
    assert not ids.hasId(1)
    assert [ids.getId(), ids.getId()] == [1, 2]
    ids.clear()
    assert ids.getId() == 0


def test_pretty_object_prints_its_class_name():
    class Thing(PrettyObject):
        pass

    assert str(Thing()) == Thing().class_name == "Thing"


def test_prevent_skips_a_method_while_attributes_match():
    class Door:
        locked = True

        @prevent(locked=True)
        def open(self):
            return "open"

    door = Door()
    assert door.open() is None
    door.locked = False
    assert door.open() == "open"


def test_time_keepers_return_the_average():
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


def test_timer_logs_elapsed_time(caplog):
    caplog.set_level(logging.INFO)
    timer = Timer("load")
    timer.tic("ontology")
    assert timer.toc("ontology") >= 0.0
    assert "[load] ontology" in caplog.text


def test_ontology_type_names():
    assert ontology_type2name("skiros:LargeBox") == "skiros_LargeBox"
    assert ontology_type2name_dict("skiros:LargeBox") == {"prefix": "skiros", "name": "LargeBox"}
