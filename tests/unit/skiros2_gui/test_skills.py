"""The presenter of the tab "Skills", on robots and a scene in this process."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from skiros2_common.core.errors import TimedOut
from skiros2_common.core.explanation import INFERENCE, PRE
from skiros2_common.core.limits import NO_LIMITS, Limits
from skiros2_common.core.world_element import Element
from skiros2_gui.app.events import StopRequested
from skiros2_gui.app.tasks import RESUME, STEP, is_silent, message_text
from skiros2_gui.app.window import Window
from skiros2_gui.skills.catalogue import rows_of
from skiros2_gui.skills.form import Editor, Field, ValueMode
from skiros2_gui.skills.presenter import RETRY_PERIOD, Refused, SkillsPresenter
from skiros2_gui.skills.start_status import start_status
from skiros2_live.core.patch import TaskProgress
from skiros2_runs.core.states import TaskState
from skiros2_runs.core.task_run import TaskRun
from skiros2_skill.client.description import Parameter
from support.fuzz import examples
from support.programs import PATIENCE
from support.progress import FAILURE, SUCCESS, root
from support.window.local_system import LocalSystem
from support.window.synchronous import make_window
from unit.skiros2_gui.lab_skills import fetch, fetch_gently, furnish, note

ROBOT = "/robot"
FETCH = (ROBOT, "skiros:Fetch", "")
GENTLY = (ROBOT, "skiros:Fetch", "fetch_gently")
NOTE = (ROBOT, "skiros:Note", "note")


@dataclass
class Lab:
    window: Window
    system: Any
    skills: SkillsPresenter
    ids: dict[str, str]

    def field(self, key: str) -> Field:
        assert self.skills.form is not None
        return self.skills.form.fields[key]

    def until(self, state: str) -> None:
        """Takes news until the task that was started last is so."""
        while True:
            last = self.window.tasks.last_started(ROBOT)
            if last is not None and last.state == state:
                return
            assert self.heard.wait(PATIENCE), f"no {state} was reported"
            self.heard.clear()
            self.window.process_events()

    def __post_init__(self) -> None:
        self.heard = threading.Event()
        self.window._event_queue._wake = self.heard.set
        self.window.process_events()


@pytest.fixture
def lab() -> Iterator[Lab]:
    window = make_window(LocalSystem)
    system: Any = window.system
    ids = furnish(system.world)
    system.add_manager(ROBOT, [fetch, fetch_gently, note])
    skills = SkillsPresenter(window)
    yield Lab(window, system, skills, ids)
    system.close()


# -- the tree ------------------------------------------------------------------------------------------------------


def _names(lab: Lab) -> list[tuple[str, list[str]]]:
    return [(row.offer.name, [o.name for o in row.children]) for robot in lab.skills.rows for row in robot.skills]


def test_skill_has_implementations_as_children(lab: Lab) -> None:
    assert _names(lab) == [("Fetch", ["fetch", "fetch_gently"]), ("note", [])]


def test_search_covers_names_and_parameters(lab: Lab) -> None:
    lab.skills.search_for("gently")
    assert _names(lab) == [("Fetch", ["fetch_gently"])]
    lab.skills.search_for("MARKS note")
    assert _names(lab) == [("note", [])]
    lab.skills.search_for("nothing like it")
    assert lab.skills.rows == ()


def test_skills_of_a_disconnected_robot_are_removed(lab: Lab) -> None:
    lab.skills.choose(NOTE)
    lab.skills.write("Text", "kept")
    assert lab.skills.can_start
    lab.system.remove_manager(ROBOT)
    lab.window.process_events()
    assert rows_of({}) == lab.skills.rows == ()
    assert not lab.skills.can_start
    lab.system.add_manager(ROBOT, [note])
    lab.window.process_events()
    assert lab.skills.can_start
    assert lab.field("Text").text == "kept"


def test_skills_are_read_again_if_their_robot_did_not_answer(lab: Lab, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail() -> list[Any]:
        raise TimedOut("it did not answer")

    now = 100.0
    with monkeypatch.context() as busy:
        busy.setattr(lab.system.managers[ROBOT], "read_skills", fail)
        skills = SkillsPresenter(lab.window, lambda: now)
        assert "reading the skills of /robot" in lab.window.problems.newest.line  # type: ignore[union-attr]
    skills.refresh_if_ready()
    assert skills.rows == ()
    now += RETRY_PERIOD + 0.1
    skills.refresh_if_ready()
    assert [robot.skills for robot in skills.rows] == [robot.skills for robot in lab.skills.rows]


# -- one parameter -------------------------------------------------------------------------------------------------


def _field(
    wire_type: str, *default: Any, kind: str = "required", description: str = "", limits: Limits = NO_LIMITS
) -> Field:
    return Field(Parameter("Key", kind, wire_type, list(default), description, limits))


@pytest.mark.parametrize(
    ("wire_type", "editor", "text", "values"),
    [
        ("str", Editor.TEXT, "[1]", ["[1]"]),
        ("int", Editor.NUMBER, " 7 ", [7]),
        ("float", Editor.NUMBER, "1e-3", [0.001]),
        ("list", Editor.JSON, "[1, [2]]", [[1, [2]]]),
        ("dict", Editor.JSON, '{"a": {"b": null}}', [{"a": {"b": None}}]),
    ],
)
def test_each_type_has_an_editor(wire_type: str, editor: Editor, text: str, values: list[Any]) -> None:
    field = _field(wire_type)
    assert field.editor is editor
    assert field.error
    field.write(text)
    assert (field.error, field.values()) == ("", values)


@pytest.mark.parametrize(
    ("wire_type", "text", "error"),
    [
        ("int", "1.5", "'1.5' is not a whole number"),
        ("float", "nan", "'nan' is not a number"),
        ("float", "fast", "'fast' is not a number"),
        ("list", "{}", "a list is needed, such as [1, 2]"),
        ("dict", '{"a":}', "this is not JSON, column 6: Expecting value"),
        ("dict", "[" * 100_000, "this cannot be read: nested too deeply"),
        ("int", "", "a whole number is needed"),
    ],
)
def test_invalid_value_has_error(wire_type: str, text: str, error: str) -> None:
    field = _field(wire_type)
    field.write(text)
    assert field.error == error


def test_number_outside_limits_has_error() -> None:
    field = _field("float", 0.5, kind="optional", limits=Limits("m/s", 0.1, 2))
    field.write("3")
    assert field.error == "expected 0.1 to 2 m/s"


def test_words_of_the_description_are_no_limits() -> None:
    field = _field("float", 0.5, kind="optional", description="0.1 to 2 (m/s)")
    field.write("3")
    assert (field.error, field.values()) == ("", [3.0])


@pytest.mark.parametrize(
    ("wire_type", "choices", "text", "values", "wrong"),
    [("str", ("slow", "fast"), "fast", ["fast"], "faster"), ("int", (1, 2, 4), "4", [4], "3")],
)
def test_parameter_with_choices_has_a_list_of_them(
    wire_type: str, choices: tuple[Any, ...], text: str, values: list[Any], wrong: str
) -> None:
    field = _field(wire_type, choices[0], limits=Limits(choices=choices))
    assert (field.editor, field.options) == (Editor.CHOICE, tuple(map(str, choices)))
    field.write(text)
    assert field.values() == values
    field.write(wrong)
    assert field.error == f"expected one of {', '.join(map(str, choices))}"


def test_each_value_of_a_list_is_checked() -> None:
    field = _field("float", 1.0, 2.0, limits=Limits(maximum=5))
    field.write("[3, 7, 4, 9]")
    assert field.error == "expected at most 5, got 7.0, 9.0"


def test_several_defaults_are_edited_as_list() -> None:
    field = _field("float", 1.0, 2.0)
    assert (field.editor, field.text) == (Editor.JSON, "[1.0, 2.0]")
    field.write("[3, 4]")
    assert field.values() == [3.0, 4.0]
    field.write('[3, "x"]')
    assert field.error == "a list of values, each a number is needed"


def test_optional_value_without_default_may_be_unset() -> None:
    field = _field("int", kind="optional")
    assert (field.mode, field.values()) == (ValueMode.UNSET, [])
    field.write("3")
    assert field.values() == [3]
    field.write("")
    assert (field.mode, field.error) == (ValueMode.UNSET, "")


_KINDS = st.sampled_from(["str", "int", "float", "bool", "list", "dict", "geometry::Thing", "skiros_wm::Element"])


@given(_KINDS, st.text(max_size=8) | st.floats().map(str) | st.integers().map(str), st.text(max_size=30))
@settings(max_examples=examples(40))
def test_any_text_is_a_value_or_an_error(wire_type: str, text: str, description: str) -> None:
    field = _field(wire_type, description=description)
    field.write(text)
    if not field.error:
        assert field.declared.wire(field.values())
    field.reset()
    assert field.is_default or not field.declared.default


# -- what would come of a start ------------------------------------------------------------------------------------


def test_preview_shows_inferred_elements(lab: Lab) -> None:
    lab.skills.choose(FETCH)
    assert [f.key for f in lab.skills.form.fields.values()][:2] == ["Thing", "Times"]
    preview = lab.skills.preview
    assert preview.start.refusal is None
    assert {key: element.label for key, element in preview.start.elements.items()} == {
        "Box": "box",
        "Thing": "bolt",
        "Robot": "skiros:test_robot",
    }
    assert [c.label for c in preview.choices["skiros:Product"]] == ["bolt", "nut"]


def test_preview_explains_a_refusal(lab: Lab) -> None:
    lab.skills.choose(FETCH)
    lab.skills.choose_value("Thing", lab.ids["nut"])
    refusal = lab.skills.preview.start.refusal
    assert [tried.label for tried in refusal.tried] == ["fetch", "fetch_gently"]
    assert refusal.tried[0].stage == INFERENCE
    assert "none skiros:contain" in refusal.tried[0].message
    lab.skills.choose((ROBOT, "skiros:Fetch", "fetch"))
    lab.skills.choose_value("Thing", lab.ids["nut"])
    lab.skills.choose_value("Box", lab.ids["box"])
    refusal = lab.skills.preview.start.refusal
    assert (refusal.stage, [f.label for f in refusal.findings]) == (PRE, ["BoxHasThing", "Weighed"])


def test_element_of_undeclared_class_is_not_refused(lab: Lab) -> None:
    world = lab.system.world
    bag = Element("skiros:Container", "bag")
    bag.addRelation("skiros:Scene-0", "skiros:contain", "-1")
    bag.addRelation("-1", "skiros:contain", lab.ids["bolt"])
    world.add_element(bag)
    lab.skills.choose(FETCH)
    lab.skills.choose_value("Box", bag.id)
    assert lab.skills.preview.start.refusal is None


def test_removed_element_is_named_in_the_preview(lab: Lab) -> None:
    lab.skills.choose(FETCH)
    lab.skills.choose_value("Thing", "skiros:Product-99")
    assert "skiros:Product-99" in lab.skills.preview.start.refusal.message


def test_refresh_uses_the_changed_scene(lab: Lab) -> None:
    lab.skills.choose(FETCH)
    world = lab.system.world
    world.remove_element(world.get_element(lab.ids["bolt"]))
    lab.window.process_events()
    lab.skills.refresh()
    assert lab.skills.preview.start.refusal is not None


# -- starting ------------------------------------------------------------------------------------------------------


def test_skill_is_started_paused_resumed_and_stopped(lab: Lab) -> None:
    lab.skills.choose(FETCH)
    assert not lab.skills.can_start  # Times is missing
    lab.skills.write("Times", "2")
    assert lab.skills.can_start
    lab.skills.start()
    lab.until("running")
    row = lab.window.tasks.last_started(ROBOT)
    assert row.latest.shape.skills_text().lower() == "fetch"
    lab.window.tasks.toggle(row)
    lab.until("paused")
    lab.window.tasks.command(STEP, ROBOT, row.task_id)
    robot = lab.system.managers[ROBOT]
    while robot.read_tasks()[0][0].progress_message != "paused":  # the tick takes its time
        lab.heard.wait(1.0)
    lab.window.tasks.command(RESUME, ROBOT, row.task_id)
    lab.until("running")
    lab.skills.toggle()
    lab.until("preempted")


def test_start_with_one_tick_pauses_the_task(lab: Lab) -> None:
    lab.skills.choose(FETCH)
    lab.skills.write("Times", "2")
    lab.skills.start(ticks_once=True)
    lab.until("paused")


def test_several_tasks_run_at_once(lab: Lab) -> None:
    lab.skills.choose(FETCH)
    lab.skills.write("Times", "2")
    lab.skills.start()
    lab.skills.start()
    lab.until("running")
    assert [row.state for row in lab.window.tasks.rows] == ["running", "running"]
    lab.window.publish(StopRequested())
    lab.until("preempted")


def test_refused_start_has_explanation(lab: Lab) -> None:
    lab.skills.choose(FETCH)
    lab.skills.write("Times", "2")
    lab.skills.choose_value("Thing", lab.ids["nut"])
    world = lab.system.world
    world.remove_element(world.get_element(lab.ids["nut"]))
    lab.skills.start()
    assert "there is no element" in lab.skills.refused.text
    assert "Thing" in {origin.key for origin in lab.skills.refused.explanation.tried[0].params}


def test_first_line_of_a_refusal_is_its_text(lab: Lab) -> None:
    lab.skills.choose(FETCH)
    lab.skills.refused = Refused("KeyError: 'To' (pick.py, line 7)\nTraceback\n  more")
    said = start_status(lab.skills)
    assert said.text == "Refused: KeyError: 'To' (pick.py, line 7)"
    assert said.details == ("Traceback", "  more")


def test_failed_task_has_reason(lab: Lab) -> None:
    lab.skills.choose(NOTE)
    lab.skills.write("Text", "hello")
    lab.skills.choose_value("Loud", True)
    lab.skills.start()
    lab.until("failed")
    row = lab.window.tasks.rows[0]
    lab.window.tasks.ask_why(row)
    assert "too loud" in "\n".join(lab.window.tasks.why)
    lab.window.tasks.clear_ended()
    assert lab.window.tasks.rows == []


def test_running_task_without_messages_is_silent() -> None:
    run = TaskRun(ROBOT, 3)
    run.record([root()], 10.0)
    assert (is_silent(run, 14.0), is_silent(run, 16.0)) == (False, True)
    run.record([root(state=SUCCESS, code=1)], 17.0)
    assert not is_silent(run, 99.0)


def test_message_older_than_the_last_one_is_skipped(lab: Lab) -> None:
    lab.window.publish(TaskProgress(ROBOT, [root(status=TaskState.PAUSED)], 11.0))
    lab.window.publish(TaskProgress(ROBOT, [root()], 10.0))
    assert [run.state for run in lab.window.tasks.rows] == ["paused"]
    lab.window.publish(TaskProgress(ROBOT, [root()], 12.0))
    assert [run.state for run in lab.window.tasks.rows] == ["running"]


def test_task_that_runs_a_handler_of_its_preemption_is_ending(lab: Lab) -> None:
    text = "ending: on_preempt of skiros:Hold-hold (skiros:PutDown)"
    lab.window.publish(TaskProgress(ROBOT, [root(state=FAILURE, message=text, status=TaskState.ENDING)], 11.0))
    (run,) = lab.window.tasks.rows
    assert (run.state, run.is_finished, message_text(run)) == ("ending", False, text)


def test_tasks_of_a_disconnected_robot_are_lost(lab: Lab) -> None:
    lab.skills.choose(FETCH)
    lab.skills.write("Times", "2")
    lab.skills.start()
    lab.until("running")
    lab.system.remove_manager(ROBOT)
    lab.window.process_events()
    assert lab.window.tasks.rows[0].is_finished


def test_progress_without_nodes_is_ignored(lab: Lab) -> None:
    root = lab.system.managers[ROBOT]
    lab.window.publish(TaskProgress("/ghost", (), 0.0))
    assert lab.window.tasks.rows == []
    assert root.read_tasks() == []
