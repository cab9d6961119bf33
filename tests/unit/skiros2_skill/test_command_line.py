"""The commands of `rosrun skiros2_skill` with a manager in this process: requests, output and exit status."""

import json
from typing import Any, NamedTuple

import pytest
import rospy

from skiros2_common.command_line.command import Unavailable, UsageError
from skiros2_common.core.errors import Refused, UnknownName, WrongValue
from skiros2_common.core.explanation import Explanation
from skiros2_common.core.skill_description import SkillDescription
from skiros2_common.core.world_element import Element
from skiros2_common.ros.utils import serializeParamMap
from skiros2_msgs import msg as msgs
from skiros2_skill.client.description import Why, find_skill, read_skill
from skiros2_skill.command_line import connection, program, queries
from skiros2_skill.command_line.assignments import read_steps
from skiros2_skill.command_line.queries import World
from skiros2_skill.core.breakpoint import Breakpoint
from skiros2_skill.core.start_preview import StartPreview
from skiros2_skill.ros.registration import Registration
from unit.skiros2_skill.skills import CONTAINER, INFERRED, OBJECT, OPTIONAL, REQUIRED, contains, describe, primitive

ROBOT = "/test_robot"
TIRED = Explanation("pre", "skiros:Grasp", "soft_grasp", 1, -1, "Grasp failed")

Grasp = describe(
    "Grasp",
    [
        ("Force", float, REQUIRED),
        CONTAINER,
        OBJECT,
        ("Speed", 0.5, OPTIONAL),
        ("Count", int, OPTIONAL),
        ("Careful", bool, OPTIONAL),
        ("Name", str, OPTIONAL),
        ("Joints", list, OPTIONAL),
        ("Options", dict, OPTIONAL),
    ],
    pre=[contains()],
    hold=[
        contains(),
        lambda d: d.getPropCond("Light", "skiros:Weight", "Object", "<", 2.0, True),
        lambda d: d.getSignalCond("Gentle", "skiros:WristForce", "Container", maximum="Force"),
    ],
    post=[contains(state=False), lambda d: d.getHasPropCond("Weighed", "skiros:Weight", "Object", True)],
)


class Measure(SkillDescription):
    def createDescription(self):
        self.addParam("Force", float, OPTIONAL, unit="N", minimum=0)


Grasp.__doc__ = "Closes the gripper."
SKILLS = [primitive(Grasp, "soft_grasp"), primitive(Grasp, "hard grasp"), primitive(Measure, "measure")]


class FakeManager:
    """Stands in for a manager and records its commands."""

    name, author, world_model = ROBOT, "tests", None

    def __init__(self, skills) -> None:
        self._skills = skills
        self.calls: list[tuple[Any, ...]] = []
        self.known_breakpoints: dict[int, Breakpoint] = {}
        self.refuses = ""
        self.run_by_number: list[int] = []
        self.status = msgs.SafetyStatus(state="running")

    def read_skills(self):
        return self._skills

    def safety(self):
        return self.status

    def command(self, action, task_id, skills=()):
        if self.refuses:
            raise Refused(self.refuses)
        self.calls.append((action, task_id, *skills))
        return task_id if task_id >= 0 or not skills else 7

    def read_tasks(self, task_id=-1):
        return [[msgs.SkillProgress(id=n)] for n in self.run_by_number if task_id in (-1, n)]

    def why(self, task_id):
        self.calls.append(("why", task_id))
        if task_id == 9:
            raise UnknownName("task 9 is not known")
        return Why("task 3 has failed: tired\nGrasp failed", [TIRED])

    def preview(self, steps):
        if self.refuses:
            return StartPreview(refusal=TIRED)
        return StartPreview("soft_grasp", {"Object": Element("skiros:Product", "nut", "skiros:Product-3")})

    def set_breakpoint(self, kind, pattern, when=""):
        self.known_breakpoints[1] = Breakpoint(kind, pattern, when or "start")
        return 1

    def remove_breakpoint(self, number):
        self.calls.append(("remove", number))

    def breakpoints(self):
        return self.known_breakpoints


class Result(NamedTuple):
    status: int
    out: str
    err: str

    @property
    def json(self) -> Any:
        return json.loads(self.out)


def register(bench, *skills):
    """Loads skills, and tells the world model of them as a manager does."""
    bench.load(*skills)
    registration = Registration(bench.wmi, "skiros", "test_robot", ROBOT)
    registration.robot_id = bench.robot.id
    robot = bench.wmi.get_element(bench.robot.id)
    robot.setProperty("skiros:SkillMgr", ROBOT)
    bench.wmi.update_element(robot)
    registration.register_skills(bench.library.implementations())


@pytest.fixture
def skills(bench):
    """The skills as a manager would describe them; the world model has them as it would register them."""
    register(bench, *SKILLS)
    found = []
    for implementation in bench.library.implementations():
        params = [message.param for message in serializeParamMap(implementation.declared.params)]
        found.append(read_skill(implementation.type, implementation.label, params))
    return found


@pytest.fixture
def manager(skills):
    return FakeManager(skills)


@pytest.fixture
def run(manager, bench, monkeypatch, capsys):
    """Runs a command to its end."""
    monkeypatch.setattr(program, "connect", lambda robot, author: manager)
    monkeypatch.setattr(queries, "connect", lambda name, author: bench.wmi)

    def run(name: str, *arguments: str) -> Result:
        capsys.readouterr()
        with pytest.raises(SystemExit) as end:
            program.run(name, arguments)
        return Result(int(end.value.code or 0), *capsys.readouterr())

    return run


# -- list, describe, why -----------------------------------------------------------------------------------------------


def test_list_shows_required_parameters_first_and_omits_the_robot(run):
    lines = [line.split(maxsplit=2) for line in run("list").out.splitlines()]
    assert lines[0] == ["skill", "type", "parameters"]
    assert lines[3] == [
        "soft_grasp", "skiros:Grasp",
        "Force Object [Container] [Speed=0.5] [Count] [Careful] [Name] [Joints] [Options]",
    ]  # fmt: skip
    assert lines[4] == ["measure", "skiros:Measure", "[Force]"]


def test_json_list_has_parameters_with_types(run):
    measure = run("list", "--json").json[-1]
    assert (measure["type"], measure["label"]) == ("skiros:Measure", "measure")
    assert measure["parameters"][0] == {
        "key": "Force", "kind": "optional", "type": "float", "default": [], "description": "",
        "unit": "N", "minimum": 0.0,
    }  # fmt: skip


def test_describe_shows_parameters_conditions_package_and_other_implementations(run):
    shown = run("describe", "soft_grasp")
    assert (shown.status, shown.err) == (0, "")
    lines = [" ".join(line.split()) for line in shown.out.splitlines()]
    assert lines[0] == "soft_grasp: Closes the gripper."
    assert "type skiros:Grasp" in lines
    assert "also hard grasp (other implementations of skiros:Grasp)" in lines
    assert lines[lines.index("parameters") + 1] == "Force required float"
    assert "Speed optional float = 0.5" in lines
    assert "Object required skiros:Product" in lines
    assert lines[lines.index("pre-conditions") + 1] == "Contains Container skiros:contain Object"
    assert "Light Object skiros:Weight < 2.0" in lines[lines.index("hold-conditions") :]
    assert "Gentle skiros:WristForce of Container is at most Force" in lines[lines.index("hold-conditions") :]
    after = lines[lines.index("post-conditions") :]
    assert "Contains not Container skiros:contain Object" in after
    assert "Weighed Object has a value of skiros:Weight" in after


def test_describe_shows_module_and_superclasses(run, bench):
    described = run("describe", "measure", "--json").json[0]
    assert described["module"] == SKILLS[2].__module__
    assert f"module  {described['module']}" in run("describe", "measure").out
    chain = described["classes"]
    assert chain[-1] == "skiros:Measure"
    assert bench.wmi.get_super_class(chain[0]) == "skiros:Skill"
    assert chain[-2].removeprefix("skiros:") in run("describe", "measure").out


def test_describe_shows_the_limits_of_parameters(run):
    assert "Force  optional  float         at least 0 N" in run("describe", "measure").out
    (force, _) = run("describe", "measure", "--json").json[0]["parameters"]
    assert (force["unit"], force["minimum"], "maximum" in force) == ("N", 0.0, False)


def test_describe_of_a_type_shows_all_its_implementations(run):
    assert [found["label"] for found in run("describe", "Grasp", "--json").json] == ["soft_grasp", "hard grasp"]
    assert run("describe", "skiros:Grasp").out.count("parameters") == 2


def test_describe_without_a_world_model_reports_missing_conditions(run, monkeypatch):
    def absent(name, author):
        raise Unavailable("there is no world model /wm")

    monkeypatch.setattr(queries, "connect", absent)
    shown = run("describe", "measure")
    assert shown.status == 0
    assert shown.out.splitlines()[-1] == "conditions are not known: there is no world model /wm"
    assert "Force" in shown.out


def test_why_shows_the_last_failure_or_that_of_a_task(run, manager):
    assert run("why").out == "task 3 has failed: tired\nGrasp failed\n"
    assert run("why", "3", "--json").json == [TIRED.to_dict()]
    assert manager.calls == [("why", -1), ("why", 3)]
    assert run("why", "9") == (1, "", "why: task 9 is not known\n")


# -- names -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["hard grasp", "skiros:Grasp-hard grasp", "Grasp-hard grasp"])
def test_skill_is_named_by_its_label(skills, name):
    choice = find_skill(name, skills)
    assert (choice.type, choice.label) == ("skiros:Grasp", "hard grasp")


@pytest.mark.parametrize("name", ["Grasp", ":Grasp", "skiros:Grasp"])
def test_type_selects_any_implementation(skills, name):
    choice = find_skill(name, skills)
    assert (choice.type, choice.label, len(choice.skills)) == ("skiros:Grasp", "", 2)


@pytest.mark.parametrize(("name", "hint"), [("grasp", "Grasp"), ("mesure", "measure"), ("soft_gras", "soft_grasp")])
def test_unknown_skill_is_refused_with_the_nearest(run, name, hint):
    assert run("describe", name) == (1, "", f"describe: there is no skill {name!r}; did you mean {hint!r}?\n")


def test_unknown_name_without_near_ones_lists_all_names(skills):
    with pytest.raises(UnknownName, match=r"there are: soft_grasp, Grasp, .* measure"):
        find_skill("qqqqqq", skills)


# -- values ------------------------------------------------------------------------------------------------------------


def values(skills, *words, find=lambda declared, name: name):
    """What a command line sends for the first skill, by key."""
    params = map(json.loads, read_steps(words, skills, find)[0].params)
    return {p["key"]: p["values"] for p in params}


@pytest.mark.parametrize(
    ("word", "expected"),
    [
        ("Force=2", [2.0]),
        ("Force=-1e-3", [-0.001]),
        ("Force=[1, 2.5]", [1.0, 2.5]),
        ("Count=7", [7]),
        ("Careful=true", [True]),
        ("Careful=False", [False]),
        ("Name=a=b c", ["a=b c"]),
        ("Name=7", ["7"]),
        ("Name=", [""]),
        ('Name=["a", "b"]', ["a", "b"]),
        ("Name=[1, 2]", ["[1, 2]"]),
        ("Joints=[1, 2]", [[1, 2]]),
        ('Options={"a": {"b": null}}', [{"a": {"b": None}}]),
        ("Object=product", ["product"]),
        ('Object=["product", "other product"]', ["product", "other product"]),
    ],
)
def test_values_have_the_declared_type(skills, word, expected):
    sent = values(skills, "soft_grasp", *([] if word.startswith("Force") else ["Force=1"]), word)
    assert sent[word.partition("=")[0]] == expected


@pytest.mark.parametrize(
    ("word", "reason"),
    [
        ("Force=much", "parameter Force: 'much' is not a valid float"),
        ("Force=[1, true]", "parameter Force: expected a value of type float, got bool True"),
        ("Count=1.5", "parameter Count: '1.5' is not a valid int"),
        ("Careful=perhaps", "parameter Careful: expected True or False, got 'perhaps'"),
        ("Joints=1", "parameter Joints: expected a list in JSON, got '1'"),
        ("Options=[", r"parameter Options: expected a dict in JSON, got '\['"),
    ],
)
def test_value_of_a_wrong_type_is_refused(skills, word, reason):
    with pytest.raises(WrongValue, match=f"soft_grasp, {reason}"):
        read_steps(["soft_grasp", "Force=1", word], skills, lambda declared, name: name)


def test_repeated_key_has_several_values(skills):
    assert values(skills, "soft_grasp", "Force=1", "Joints=[1]", "Joints=[2]")["Joints"] == [[1], [2]]


def test_value_of_a_registered_type_is_given_in_json():
    declared = '{"key": "Pose", "specType": 1, "type": "lab::Pose", "values": [], "description": ""}'
    skills = [read_skill("skiros:Move", "move", [declared])]
    assert values(skills, "move", 'Pose={"x": 1}') == {"Pose": [{"x": 1}]}
    with pytest.raises(WrongValue, match="expected the JSON form of lab::Pose, got 'home'"):
        values(skills, "move", "Pose=home")


def test_unknown_parameter_is_refused_with_the_nearest(skills):
    with pytest.raises(UnknownName, match=r"soft_grasp has no parameter 'force'; did you mean 'Force'\?"):
        read_steps(["soft_grasp", "force=1"], skills, None)


def test_all_problems_of_parameters_are_reported_at_once(skills):
    with pytest.raises(UnknownName) as refused:
        read_steps(["soft_grasp", "force=1", "Speed=fast"], skills, None)
    for problem in ("no parameter 'force'", "needs Force (float)", "parameter Speed: "):
        assert problem in str(refused.value)


def test_missing_parameters_are_named_with_their_types(run, manager):
    refused = run("run", "soft_grasp", "Speed=1")
    assert refused == (1, "", "run: soft_grasp needs Force (float): give it as Force=VALUE\n")
    assert manager.calls == []


def test_parameter_of_an_earlier_skill_is_not_required(skills):
    steps = read_steps(["measure", "soft_grasp", "Name=x"], skills, None)
    assert [(step.type, step.label) for step in steps] == [
        ("skiros:Measure", "measure"), ("skiros:Grasp", "soft_grasp"),
    ]  # fmt: skip


def test_value_before_the_first_skill_is_wrong_usage(run):
    assert run("run", "Force=1").status == 2


def test_label_may_contain_an_equals_sign():
    declared = '{"key": "c", "specType": 0, "type": "int", "values": []}'
    steps = read_steps(["a=b", "c=1"], [read_skill("skiros:A", "a=b", [declared])], None)
    assert (steps[0].label, len(steps[0].params)) == ("a=b", 1)


def test_detached_skills_are_started_in_one_request(run, manager):
    started = run("run", "--detach", "Grasp", "Force=1", "Object=product", "measure", "--json")
    assert (started.status, started.json) == (0, {"robot": ROBOT, "task": 7})
    ((action, task_id, grasp, measure),) = manager.calls
    assert (action, task_id) == ("start", -1)
    assert [(s.type, s.label, len(s.params)) for s in (grasp, measure)] == [
        ("skiros:Grasp", "", 2), ("skiros:Measure", "measure", 0),
    ]  # fmt: skip
    product = json.loads(grasp.params[1])["values"][0]
    assert product["label"] == "product"
    assert product["id"].startswith("skiros:Product-")


def test_preview_shows_the_inferred_elements(run, manager):
    shown = run("preview", "Grasp", "Force=1")
    assert (shown.status, shown.out) == (0, 'soft_grasp would start\n  Object = skiros:Product-3 "nut"\n')
    assert manager.calls == []


def test_preview_of_a_refused_start_has_reason_and_status_1(run, manager):
    manager.refuses = "tired"
    shown = run("preview", "Grasp", "Force=1")
    assert (shown.status, shown.out.splitlines()[0]) == (1, "it would be refused")
    assert "Grasp failed" in shown.out
    assert run("preview", "Grasp", "Force=1", "--json").json["refusal"] == TIRED.to_dict()


# -- elements ----------------------------------------------------------------------------------------------------------


def test_elements_are_named_by_id_or_label(run, bench, skills):
    declared = skills[0].parameters["Object"]
    known = World(ROBOT, "tests")
    for name in (bench.product.id, "product"):
        assert known.find_element(declared, name)["id"] == bench.product.id


def test_ambiguous_label_is_refused_with_the_ids(run, bench, skills):
    twin = bench.add("skiros:Product", "product", bench.tray)
    with pytest.raises(WrongValue, match=f"2 elements are labelled 'product', .*{twin.id}: give the id"):
        World(ROBOT, "tests").find_element(skills[0].parameters["Object"], "product")


@pytest.mark.parametrize("name", ["prodct", "tray"])
def test_unknown_element_is_refused(run, skills, name):
    with pytest.raises(UnknownName, match=f"there is no skiros:Product with the id or label '{name}'; "):
        World(ROBOT, "tests").find_element(skills[0].parameters["Object"], name)


def test_world_model_of_the_managers_namespace_is_used(monkeypatch, bench):
    asked = []
    monkeypatch.setattr(queries, "connect", lambda name, author: asked.append((name, author)) or bench.wmi)
    with pytest.raises(UnknownName):
        World("/cell/robot", "mary").registered("skiros:Grasp", "none")
    assert asked == [("/cell/wm", "mary")]


def test_conditions_are_described_in_words(run, bench):
    checks = describe(
        "Check",
        [OBJECT, ("Lid", Element("skiros:Part"), INFERRED)],
        pre=[
            _either,
            lambda d: d.getIsSpecifiedCond("Known", "Object", False),
            lambda d: d.getOnTypeCond("Kind", "Object", "skiros:Starter"),
            lambda d: d.getAbstractRelationCond("May", "skiros:contain", "Lid", "Object", True),
        ],
    )
    register(bench, primitive(checks, "check"))
    conditions = World(ROBOT, "tests").registered("skiros:Check", "check").conditions["pre"]
    assert {condition.text for condition in conditions} == {
        "(Object skiros:Weight = 1.0 or not Object has a value of skiros:Weight)",
        "not Object is an element of the scene",
        "Object is a skiros:Starter",
        "the ontology allows Lid skiros:contain Object",
    }


def _either(description):
    condition = description.getOrCond(True)
    condition.addCondition(description.getPropCond("One", "skiros:Weight", "Object", "=", 1.0, True))
    condition.addCondition(description.getHasPropCond("Other", "skiros:Weight", "Object", False))
    return condition


# -- stop, pause, resume, step, breakpoint -----------------------------------------------------------------------------


@pytest.mark.parametrize(("name", "action"), [("stop", "preempt"), ("pause", "pause")])
def test_one_task_or_all_are_stopped_or_paused(run, manager, name, action):
    assert run(name, "3").out.startswith("task 3 is ")
    assert run(name).out.startswith("all tasks are ")
    assert manager.calls == [(action, 3), (action, -1)]


def test_task_is_resumed_or_ticked_once(run, manager):
    assert run("resume", "3").out == "task 3 is resumed\n"
    assert run("step", "3").out == "task 3 was ticked once\n"
    assert manager.calls == [("start", 3), ("tick_once", 3)]


def test_stop_of_the_robot_is_shown(run, manager):
    assert run("safety") == (0, f"{ROBOT} is not stopped\n", "")
    stops = ["emergency stop by /e_stop: data is True", "fault by /arm: hot"]
    manager.status = msgs.SafetyStatus("emergency_stop", "/e_stop", "data is True", rospy.Time(1795291003), stops)
    first, second = run("safety").out.splitlines()
    assert first.startswith(f"{ROBOT} is stopped since ")
    assert (first.endswith(stops[0]), second) == (True, stops[1])
    shown = json.loads(run("safety", "--json").out)
    assert (shown["state"], shown["since"], shown["stops"]) == ("emergency_stop", 1795291003.0, stops)
    assert run("list").out.splitlines()[:2] == [first, second]
    assert run("watch", "--once").out.splitlines()[:2] == [first, second]


def test_resume_without_number_resumes_all_paused_tasks(run, manager):
    manager.run_by_number = [3, 5]
    assert run("resume").out == "task 3 is resumed\ntask 5 is resumed\n"
    manager.refuses = "task 3 runs already"
    assert run("resume") == (1, "", "resume: task 3 runs already; task 3 runs already\n")
    manager.run_by_number = []
    assert run("resume") == (1, "", "resume: no task is paused\n")


def test_tick_without_number_ticks_the_only_task(run, manager):
    manager.run_by_number = [5]
    assert run("step").out == "task 5 was ticked once\n"
    manager.run_by_number = [3, 5]
    assert run("step") == (1, "", "step: there are 2 tasks (3, 5): name one\n")
    manager.run_by_number = []
    assert run("step") == (1, "", "step: no task runs\n")


# -- watch -------------------------------------------------------------------------------------------------------------


def test_watch_of_an_ended_task_is_refused(run, manager):
    manager.run_by_number = [3]
    assert run("watch", "--once", "4") == (
        1,
        "",
        f"watch: no task 4 runs on {ROBOT}; it may have ended, see why 4\n",
    )


def test_breakpoints_are_listed_added_and_removed(run, manager):
    assert run("breakpoint").out == "no breakpoints\n"
    assert run("breakpoint", "add", "node", "Gr*").out == "breakpoint 1: node Gr* start\n"
    assert run("breakpoint", "list").out.splitlines()[-1].split() == ["1", "node", "Gr*", "start"]
    assert run("breakpoint", "--json").json == [{"number": 1, "kind": "node", "pattern": "Gr*", "when": "start"}]
    assert run("breakpoint", "remove", "1").out == "breakpoint 1 is removed\n"
    assert run("breakpoint", "remove", "all").status == 0
    assert manager.calls == [("remove", 1), ("remove", -1)]


# -- usage and connection ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "arguments",
    [
        ("describe",),
        ("run",),
        ("stop", "first"),
        ("stop", "-3"),
        ("breakpoint", "add", "tree", "x"),
        ("breakpoint", "remove", "some"),
        ("list", "--none"),
    ],
)
def test_wrong_usage_is_reported_in_one_line(run, arguments):
    wrong = run(*arguments)
    assert (wrong.status, wrong.out, wrong.err.count("\n")) == (2, "", 1)


@pytest.mark.parametrize("name", sorted(program._COMMANDS))
def test_help_of_each_command_lists_its_statuses(run, name):
    shown = run(name, "--help")
    assert shown.status == 0
    assert "Exit status: 0" in shown.out


@pytest.fixture
def master(monkeypatch):
    """What the master knows: node names of managers, and whether they answer."""
    known: dict[str, bool] = {}

    def ask(call, *arguments):
        assert call == "getSystemState"
        services = [(f"{name}{end}", [name]) for name in known for end in ("/get_skills", "/command")]
        return [], [], [*services, ("/other/get_skills", ["/other"])]

    def check(name, service, what):
        if not known[name]:
            raise Unavailable(f"the {what} {name} does not answer")

    monkeypatch.setattr(connection, "ask_master", ask)
    monkeypatch.setattr(connection, "check_node", check)
    return known


def test_only_manager_is_selected(master):
    master.update({"/one": True, "/dead": False})
    assert connection.find_manager("") == "/one"


@pytest.mark.parametrize("name", ["two", "/two"])
def test_one_of_several_managers_must_be_named(master, name):
    master.update({"/one": True, "/two": True})
    with pytest.raises(UsageError, match="there are 2 skill managers, /one, /two: name one with --robot"):
        connection.find_manager("")
    assert connection.find_manager(name) == "/two"


def test_manager_in_the_own_namespace_is_named_without_it(master, monkeypatch):
    monkeypatch.setenv("ROS_NAMESPACE", "cell")
    master.update({"/cell/one": True, "/two": True})
    assert connection.find_manager("one") == "/cell/one"


def test_missing_manager_is_reported_with_dead_and_near_ones(master):
    with pytest.raises(Unavailable, match="there is no skill manager on the master"):
        connection.find_manager("")
    master["/robot"] = False
    with pytest.raises(Unavailable, match=r"no skill manager that answers \(/robot may have been killed\)"):
        connection.find_manager("")
    with pytest.raises(Unavailable, match="the skill manager /robot does not answer"):
        connection.find_manager("robot")
    with pytest.raises(Unavailable, match=r"did you mean /robot\?"):
        connection.find_manager("robto")


# -- completion --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (("run", "soft"), ["soft_grasp"]),
        (("run", "soft_grasp", "Co"), ["Container=", "Count="]),
        (("run", "soft_grasp", "Count=1", "Co"), ["Container="]),
        (("run", "soft_grasp", "Careful="), ["Careful=true", "Careful=false"]),
        (("run", "soft_grasp", "Object=ham"), ["Object=hammer"]),
        (("run", "nobody", "Co"), []),
        (("describe", "Gr"), ["Grasp"]),
        (("stop", ""), ["4", "5"]),
        (("breakpoint", "remove", ""), ["all"]),
        (("breakpoint", "add", "n"), ["node"]),
    ],
)
def test_shell_completes_words(run, bench, manager, monkeypatch, arguments, expected):
    bench.add("skiros:Product", "hammer")
    manager.run_by_number = [4, 5]
    monkeypatch.setenv("_SKIROS2_COMPLETE", "zsh")
    assert run(*arguments).out.splitlines() == expected


def test_shell_completes_ids_where_no_label_begins_so(run, bench, monkeypatch):
    hammer = bench.add("skiros:Product", "hammer")
    monkeypatch.setenv("_SKIROS2_COMPLETE", "zsh")
    assert f"Object={hammer.id}" in run("run", "soft_grasp", "Object=skiros:P").out.splitlines()
