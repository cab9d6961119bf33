"""The live plots of signals: what is drawn, and when topics are subscribed to."""

from __future__ import annotations

import math
import time
from collections.abc import Callable

import numpy as np
import pytest

from skiros2_common.core.world_element import Element
from skiros2_gui.app.window import Window
from skiros2_gui.run.presenter import RunPresenter
from skiros2_gui.run.signal_trace import GAP, LONGEST, STROKE, SignalTrace
from skiros2_gui.run.signals import SignalPlots
from skiros2_runs.core.values import MAXIMUM
from support.programs import PATIENCE
from support.window.press_cell import TOPIC, PressCell

# -- traces ------------------------------------------------------------------------------------------------------------


def trace(*values: tuple[float, float]) -> SignalTrace:
    made = SignalTrace()
    for stamp, value in values:
        made.add(value, stamp)
    return made


def test_line_has_the_values_of_the_asked_time() -> None:
    times, values = trace((1.0, 5.0), (1.1, 6.0), (1.2, 7.0)).line(1.05, 1.15)
    assert set(times) == {1.1} and set(values) == {6.0}


def test_peak_between_two_strokes_is_drawn() -> None:
    _, values = trace(*((10.0 + n * 0.001, 50.0 if n == 123 else 0.0) for n in range(200))).line(0.0, 20.0)
    assert values.max() == 50.0 and len(values) <= 2 * (0.2 / STROKE + 2)


def test_line_of_a_fast_signal_stays_short() -> None:
    made = trace(*((n * 0.0005, math.sin(n)) for n in range(80_000)))  # 40 s at 2 kHz
    times, _ = made.line(10.0, 40.0)
    assert len(times) <= 2 * LONGEST / STROKE + 2
    assert times[0] <= 40.0 - LONGEST + STROKE and times[-1] == pytest.approx(40.0, abs=2 * STROKE)


def test_nan_is_a_gap() -> None:
    _, values = trace((1.0, 5.0), (1.1, math.nan), (1.2, 7.0)).line(0.0, 2.0)
    assert np.isnan(values).tolist() == [False, False, True, True, False, False]


def test_nan_within_a_stroke_is_a_gap_and_no_value_is_lost() -> None:
    _, values = trace((1.0, 5.0), (1.001, math.nan), (1.002, 7.0)).line(0.0, 2.0)
    assert np.isnan(values).tolist() == [False, False, True, True, False, False]


def test_missing_messages_are_a_gap() -> None:
    times, values = trace((1.0, 5.0), (1.1, 6.0), (1.1 + 2 * GAP, 7.0), (1.2 + 2 * GAP, 8.0)).line(0.0, 5.0)
    broken = times[np.isnan(values)]
    assert len(broken) and 1.1 < broken[0] < 1.1 + 2 * GAP


def test_slow_signal_has_no_gaps() -> None:
    _, values = trace(*((float(n), 1.0) for n in range(10))).line(0.0, 10.0)
    assert not np.isnan(values).any()


# -- presenter ---------------------------------------------------------------------------------------------------------


@pytest.fixture
def cell(window: Window) -> PressCell:
    return PressCell(window)


@pytest.fixture
def run(window: Window) -> RunPresenter:
    return RunPresenter(window)


@pytest.fixture
def plots(window: Window, cell: PressCell, run: RunPresenter) -> SignalPlots:
    return SignalPlots(window, run)


def until(window: Window, condition: Callable[[], object]) -> None:
    end = time.monotonic() + PATIENCE
    while not condition():
        assert time.monotonic() < end
        window.process_events()
        time.sleep(0.005)


def pressing(window: Window, cell: PressCell, run: RunPresenter, plots: SignalPlots) -> None:
    """Shows the plots, and waits until the skill presses and its limit is known."""
    plots.show()
    cell.publish(1.0)
    cell.press()
    until(window, lambda: plots.refresh() or plots.limits(cell.force.id))


def test_hidden_plots_subscribe_to_no_topic(cell: PressCell, plots: SignalPlots) -> None:
    plots.refresh()
    assert cell.system.signals.topics() == []
    plots.show()
    assert cell.system.signals.topics() == [TOPIC]
    plots.hide()
    assert cell.system.signals.topics() == []


def test_signals_are_plotted_by_unit(cell: PressCell, plots: SignalPlots) -> None:
    plots.show()
    panels = {unit: [signal.label for signal in signals] for unit, signals in plots.panels().items()}
    assert panels == {"N": ["wrist force"], "Nm": ["wrist torque"]}


def test_values_are_drawn_as_they_arrive(cell: PressCell, plots: SignalPlots) -> None:
    plots.show()
    cell.publish(12.5)
    (force,) = plots.panels()["N"]
    times, values = plots.line(force)
    assert set(values) == {12.5} and plots.end - times[-1] < 10.0
    assert plots.status(force) == "12.5 N"


def test_deselected_signal_is_neither_plotted_nor_subscribed_to(cell: PressCell, plots: SignalPlots) -> None:
    plots.show()
    plots.choose(cell.force.id, False)
    plots.choose(cell.torque.id, False)
    assert plots.panels() == {} and cell.system.signals.topics() == []
    plots.choose(cell.torque.id, True)
    assert list(plots.panels()) == ["Nm"] and cell.system.signals.topics() == [TOPIC]


def test_signal_of_another_robot_is_plotted_when_chosen(
    window: Window, cell: PressCell, run: RunPresenter, plots: SignalPlots
) -> None:
    window.system.add_manager("/other", [], "skiros:other")
    other = cell.wm.resolve_element(Element("cora:Robot", "skiros:other"))
    cell.arm = cell.add(Element("rparts:ArmDevice", "other arm"), other)
    distance = cell.add_signal("skiros:Distance", "distance", "range", "m", "/range")
    pressing(window, cell, run, plots)
    assert "m" not in plots.panels() and plots.signals[-1].eid == distance.id
    plots.choose(distance.id, True)
    assert list(plots.panels()) == ["N", "Nm", "m"]


def test_relative_topic_is_in_the_namespace_of_the_robots_manager(window: Window, run: RunPresenter) -> None:
    cell = PressCell(window)
    window.system.remove_manager("/robot")
    window.system.add_manager("/cell/robot", [], "skiros:robot")
    cell.add_signal("skiros:Distance", "distance", "range", "m", "range")
    cell.add_signal("skiros:Distance", "gap", "range", "m", "~gap")
    plots = SignalPlots(window, run)
    plots.show()
    assert cell.system.signals.topics() == [TOPIC, "/cell/range", "/cell/robot/gap"]


def test_signals_of_the_same_name_are_told_apart_by_their_arms(cell: PressCell, plots: SignalPlots) -> None:
    robot = cell.wm.resolve_element(Element("cora:Robot", "skiros:robot"))
    cell.arm = cell.add(Element("rparts:ArmDevice", "right arm"), robot)
    cell.add_signal("skiros:WristForce", "wrist force", "wrench.force", "N", "/right_arm/wrench")
    plots.show()
    labels = {signal.label for signal in plots.signals}
    assert labels == {"wrist force of arm", "wrist force of right arm", "wrist torque"}


def test_signal_without_topic_says_why_it_is_not_plotted(cell: PressCell, plots: SignalPlots) -> None:
    broken = cell.add(Element("skiros:WristForce", "broken"), cell.arm)
    plots.show()
    signal = next(s for s in plots.signals if s.eid == broken.id)
    assert "skiros:SignalTopic is None, expected a topic" in plots.status(signal)


def test_unreadable_message_is_a_gap_with_its_reason(cell: PressCell, plots: SignalPlots) -> None:
    plots.show()
    cell.publish(1.0)
    cell.system.signals.publish(TOPIC, 3.0)
    (force,) = plots.panels()["N"]
    assert np.isnan(plots.line(force)[1]).any()
    assert plots.status(force) == "a message of type float has no number at 'wrench.force'"


def test_paused_plots_keep_their_lines(cell: PressCell, plots: SignalPlots) -> None:
    plots.show()
    cell.publish(1.0)
    plots.pause(True)
    cell.publish(99.0)
    (force,) = plots.panels()["N"]
    assert set(plots.line(force)[1]) == {1.0}
    plots.pause(False)
    assert 99.0 in plots.line(force)[1]


def test_limit_of_a_running_skill_is_drawn_from_its_start(
    window: Window, cell: PressCell, run: RunPresenter, plots: SignalPlots
) -> None:
    pressing(window, cell, run, plots)
    (limit,) = plots.limits(cell.force.id)
    assert (limit.bound.side, limit.bound.value, limit.bound.condition) == (MAXIMUM, 30.0, "ForceBelowLimit")
    assert limit.begin == run.run.latest.began(1) and limit.end == math.inf and not limit.bound.violated


def test_violated_limit_is_marked_at_its_time_and_ends_with_the_skill(
    window: Window, cell: PressCell, run: RunPresenter, plots: SignalPlots
) -> None:
    pressing(window, cell, run, plots)
    before = time.time()
    cell.publish(41.0)
    until(window, lambda: plots.refresh() or plots.limits(cell.force.id)[0].end < math.inf)
    (limit,) = plots.limits(cell.force.id)
    assert before <= limit.bound.violated <= time.time()
    assert limit.begin < limit.end <= time.time()


def test_limits_of_an_ended_task_are_read_once_more(
    window: Window, cell: PressCell, run: RunPresenter, plots: SignalPlots, monkeypatch: pytest.MonkeyPatch
) -> None:
    pressing(window, cell, run, plots)
    cell.publish(41.0)
    until(window, lambda: plots.refresh() or plots.limits(cell.force.id)[0].end < math.inf)
    plots.refresh()
    asked: list[int] = []
    monkeypatch.setattr(cell.manager, "signal_bounds", asked.append)
    plots.refresh()
    assert asked == []
