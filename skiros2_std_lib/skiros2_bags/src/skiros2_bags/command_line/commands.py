"""The commands that read bags, and `restore`."""

from __future__ import annotations

import argparse
import contextlib
import math
import time
from collections import Counter, defaultdict
from collections.abc import Iterable
from dataclasses import asdict
from datetime import datetime
from typing import Any

from skiros2_bags.core.bag_file import MONITOR, PROGRESS, BagError
from skiros2_bags.core.diff import Difference, Kind, diff_runs, summary
from skiros2_bags.core.restore import restore as restore_scene
from skiros2_bags.core.run import Run, check
from skiros2_bags.core.world_history import TimedChange
from skiros2_common.command_line.command import REFUSED, CommandResult, UsageError, user
from skiros2_common.command_line.layout import Branch, Screen, table, tree
from skiros2_common.core.errors import ConfigurationError, WrongValue
from skiros2_common.core.names import local_name
from skiros2_common.core.operations import RESET, Change
from skiros2_common.core.world_element import Element, RelationDict
from skiros2_runs.core.history import NodeHistory, SkillRecord, node_histories
from skiros2_runs.core.states import ENDS, FAILURE, IDLE, state_name, style_of
from skiros2_runs.core.task_run import TaskRun
from skiros2_runs.core.tolerance import Tolerance
from skiros2_world_model.command_line.reading import element_answer, element_json, scene_tree
from skiros2_world_model.core.history import changed_lines, difference
from skiros2_world_model.core.replica import apply_change
from skiros2_world_model.core.scene import Scene


def show(run: Run, arguments: argparse.Namespace, screen: Screen) -> CommandResult:
    """Prints a summary of a bag: duration, goals, tasks, actions, world model."""
    counts = Counter(message.topic for message in run.messages())
    lines = [
        screen.fitted(
            f"{run.path}: {run.end - run.start:.1f} s from {local_time(run.start)}, {counts.total()} messages"
        )
    ]
    lines += [screen.fitted(run.damage)] if run.damage else []
    lines += _section("goals", table(screen, _goal_rows(run), ("at s", "took s", "of", "outcome", "goal")))
    tasks = run.tasks() if PROGRESS in run.topics.values() else []
    rows = [_task_row(task, run) for task in tasks]
    lines += _section("tasks", table(screen, rows, ("at s", "took s", "robot", "task", "skills", "outcome")))
    lines += _section("actions", table(screen, _action_rows(run), ("action", "goals", "outcomes")))
    if MONITOR in run.topics.values():
        lines += _section("world model", [screen.fitted(line) for line in _world_lines(run)])
    if arguments.topics:
        rows = [(topic, kind, str(counts[topic])) for topic, kind in sorted(run.topics.items())]
        lines += _section("topics", table(screen, rows, ("topic", "type", "messages")))
    return CommandResult(lines, lambda: _run_json(run, tasks, counts))


def _section(title: str, lines: list[str]) -> list[str]:
    """Returns lines with a title; no lines for an empty table."""
    return ["", f"{title}:", *(f"  {line}" for line in lines)] if len(lines) > 2 or title == "world model" else []


def _goal_rows(run: Run) -> Iterable[tuple[str, ...]]:
    for goal in run.goals():
        took = f"{goal.end - goal.time:.2f}" if goal.end is not None else ""
        outcome = goal.state or goal.call.status_name
        yield relative_time(goal.time, run), took, goal.call.name, outcome, goal.goals


def _task_row(task: TaskRun, run: Run) -> tuple[str, ...]:
    latest = task.latest
    state = style_of(task.state).word if latest.has_ended else "not ended"
    message = latest.message(0) if task.state.has_ended and latest.state(0) == FAILURE else ""
    outcome = f"{state}: {message}" if message else state
    times = relative_time(task.start, run), f"{latest.time - task.start:.2f}"
    return *times, task.robot, str(task.task_id), latest.shape.skills_text(), outcome


def _action_rows(run: Run) -> Iterable[tuple[str, ...]]:
    outcomes: dict[str, Counter[str]] = defaultdict(Counter)
    for call in run.actions():
        outcomes[call.name][call.status_name] += 1
    for name, counts in outcomes.items():
        yield name, str(counts.total()), ", ".join(f"{number} {state}" for state, number in counts.items())


def _world_lines(run: Run) -> list[str]:
    changes = run.changes()
    authors = Counter(timed.change.author for timed in changes)
    by_author = ", ".join(f"{number} by {author}" for author, number in authors.most_common())
    gaps = sum(bool(timed.gap) for timed in changes)
    size = [f"{len(run.world(partial=True))} elements at the end"] if changes else []
    return [f"{len(changes)} changes: {by_author}" if changes else "no changes", *size] + (
        [f"{gaps} times changes are missing: see check"] if gaps else []
    )


def _run_json(run: Run, tasks: list[TaskRun], counts: Counter[str]) -> dict[str, Any]:
    return {
        "bag": str(run.path),
        "start": run.start,
        "end": run.end,
        "damage": run.damage,
        "goals": [
            {"time": g.time, "end": g.end, "action": g.call.name, "goals": g.goals, "state": g.state,
             "message": g.message}
            for g in run.goals()
        ],
        "tasks": [
            {"robot": t.robot, "task": t.task_id, "start": t.start, "end": t.latest.time, "ended": t.latest.has_ended,
             "state": t.state, "message": t.latest.message(0)}
            for t in tasks
        ],
        "topics": [
            {"topic": topic, "type": kind, "messages": counts[topic]} for topic, kind in sorted(run.topics.items())
        ],
    }  # fmt: skip


def check_bag(run: Run, arguments: argparse.Namespace, screen: Screen) -> CommandResult:
    """Checks that a bag is complete from the start: no change, task or goal is missing."""
    findings = check(run)
    marks = ("✓", "✗") if screen.fancy else ("ok ", "BAD")
    lines = [screen.fitted(f"{marks[not f.holds]} {f.text}") for f in findings]
    status = 0 if all(f.holds for f in findings) else REFUSED
    return CommandResult(lines, [{"holds": f.holds, "text": f.text} for f in findings], status)


def tasks(run: Run, arguments: argparse.Namespace, screen: Screen) -> CommandResult:
    """Prints the tree of each task, with the states and times of its nodes."""
    selected = [
        task
        for task in run.tasks()
        if _matches_robot(task.robot, arguments.robot) and arguments.task in (None, task.task_id)
    ]
    lines: list[str] = []
    for task in selected:
        span = f"{relative_time(task.start, run)} to {relative_time(task.latest.time, run)} s"
        title = f"{task.robot}, task {task.task_id}: {span}"
        lines += [
            "",
            screen.fitted(f"{title}{'' if task.latest.has_ended else ', not ended'}"),
            *_task_tree(task, run, screen),
        ]
    return CommandResult(lines[1:] or ["no tasks"], lambda: [_task_json(task) for task in selected])


def _task_tree(task: TaskRun, run: Run, screen: Screen) -> list[str]:
    branches: dict[int, Branch] = {}
    for node in node_histories(task).values():
        states = node.state_changes()
        marks = " ".join(style_of(s.state).symbol if screen.fancy else style_of(s.state).ascii for s in states)
        began = next((s.time for s in states if s.state != IDLE), None)
        ended = next((s.time for s in reversed(states) if s.state in ENDS), None)
        times = [relative_time(t, run) if t is not None else "" for t in (began, ended)]
        branch = Branch([_title(node), marks, *times, node.reports[-1].message])
        branches[node.id] = branch
        parent = branches.get(node.parent_id)
        if parent is not None:
            parent.branches.append(branch)
    return tree(screen, [next(iter(branches.values()))])


def _title(node: NodeHistory) -> str:
    shows_processor = node.processor and not node.name.endswith(node.processor)  # the names of groups contain it
    return f"{node.name} {node.processor}" if shows_processor else node.name


def _task_json(task: TaskRun) -> dict[str, Any]:
    return {
        "robot": task.robot,
        "task": task.task_id,
        "start": task.start,
        "end": task.latest.time,
        "nodes": [
            {
                "id": node.id, "parent": node.parent_id, "type": node.type, "label": node.label,
                "processor": node.processor,
                "states": [
                    {"time": s.time, "state": state_name(s.state), "code": s.code, "message": s.message}
                    for s in node.reports
                ],
            }
            for node in node_histories(task).values()
        ],
    }  # fmt: skip


def skills(run: Run, arguments: argparse.Namespace, screen: Screen) -> CommandResult:
    """Prints when each skill ran, and for how long."""
    selected = [
        skill
        for skill in run.skills()
        if _matches_robot(skill.robot, arguments.robot) and arguments.depth in (0, skill.depth)
    ]
    if arguments.total:
        lines = table(screen, _total_rows(selected), ("skill", "runs", "failed", "mean s", "min", "max", "sum s"))
    else:
        headers = ("skill", "robot", "task", "at s", "took s", "state", "message")
        lines = table(screen, [_skill_row(s, run) for s in selected], headers)
    return CommandResult(lines if selected else ["no skills"], lambda: [_skill_json(s) for s in selected])


def _skill_row(skill: SkillRecord, run: Run) -> tuple[str, ...]:
    name = "  " * (skill.depth - 1) + skill.label
    times = relative_time(skill.start, run), f"{skill.duration:.2f}"
    return name, skill.robot, str(skill.task_id), *times, style_of(skill.state).word, skill.message


def _total_rows(selected: Iterable[SkillRecord]) -> Iterable[tuple[str, ...]]:
    runs: dict[str, list[SkillRecord]] = defaultdict(list)
    for skill in selected:
        runs[skill.label].append(skill)
    for label, found in sorted(runs.items(), key=lambda item: -sum(s.duration for s in item[1])):
        times = [s.duration for s in found]
        failed = sum(s.state == FAILURE for s in found)
        numbers = (sum(times) / len(times), min(times), max(times), sum(times))
        yield label, str(len(found)), str(failed or ""), *(f"{number:.2f}" for number in numbers)


def _skill_json(skill: SkillRecord) -> dict[str, Any]:
    return {
        "robot": skill.robot, "task": skill.task_id, "node": skill.node_id, "depth": skill.depth, "label": skill.label,
        "type": skill.type, "start": skill.start, "end": skill.end, "state": state_name(skill.state),
        "code": skill.code, "message": skill.message,
    }  # fmt: skip


def _matches_robot(robot: str, wanted: str) -> bool:
    return not wanted or robot.strip("/") == wanted.strip("/") or local_name(robot) == wanted


def plot(run: Run, arguments: argparse.Namespace, screen: Screen) -> CommandResult:
    """Draws a PNG of the skill runs by robot and of the changes of the world model."""
    from skiros2_bags.core.gantt import save_gantt  # imports in a second

    output = arguments.output or run.path.with_suffix(".png")
    save_gantt(run, output, arguments.depth)
    return CommandResult([str(output)], {"file": str(output)})


def export(run: Run, arguments: argparse.Namespace, screen: Screen) -> CommandResult:
    """Writes the run for other tools: BAG.mcap for Foxglove and Lichtblick, BAG.rrd for the Rerun viewer."""
    folder = arguments.output or run.path.parent
    files = []
    try:
        if arguments.format in ("all", "mcap"):
            from skiros2_bags.core.mcap_export import export_mcap  # optional packages

            export_mcap(run, folder / f"{run.path.stem}.mcap")
            files.append(str(folder / f"{run.path.stem}.mcap"))
        if arguments.format in ("all", "rerun"):
            from skiros2_bags.core.rerun_export import export_rerun

            export_rerun(run, folder / f"{run.path.stem}.rrd")
            files.append(str(folder / f"{run.path.stem}.rrd"))
    except ModuleNotFoundError as error:
        install = "pip install -r requirements/export.txt"
        raise ConfigurationError(f"the package {error.name} is missing; install it with: {install}") from error
    except OSError as error:
        raise BagError(f"{folder}: the export cannot be written: {error}") from error
    return CommandResult(files, {"files": files})


#: Relations along which the tree of a scene is printed; a bag contains no ontologies to derive them from.
_SPATIAL = ("skiros:contain", "skiros:hasA")

#: Maximum number of lines per change without `--all`.
_MAX_LINES = 12


def world(run: Run, arguments: argparse.Namespace, screen: Screen) -> CommandResult:
    """Prints the scene at a time, or one element of it."""
    at = parse_time(arguments.at, run) if arguments.at else run.end
    scene = run.world(at, arguments.partial)
    elements = _elements(scene, [node.id for node in scene])
    if arguments.id:
        element = scene.element(arguments.id)
        if element is None:
            others = f"only {len(scene)} others"
            raise BagError(f"{run.path}: there was no element {arguments.id!r} at {relative_time(at, run)} s, {others}")
        answer = element_answer(element, screen)
    else:
        answer = scene_tree(elements, _SPATIAL, screen, "", arguments.all)
    return CommandResult([screen.fitted(f"at {relative_time(at, run)} s:"), "", *answer.lines], answer.data)


def changes(run: Run, arguments: argparse.Namespace, screen: Screen) -> CommandResult:
    """Prints the changes of the world model with time and author."""
    since = parse_time(arguments.since, run) if arguments.since else float("-inf")
    until = parse_time(arguments.until, run) if arguments.until else float("inf")
    scene = Scene()
    lines: list[str] = []
    data: list[dict[str, Any]] = []
    for timed in run.changes():
        details = _change_lines(scene, timed)
        change = timed.change
        matches = not arguments.id or any(arguments.id in line.split() for line in details)
        if since < timed.time <= until and arguments.author in ("", change.author) and matches:
            lines += [screen.fitted(f"MISSING: {timed.gap}")] if timed.gap else []
            lines += [screen.fitted(f"{relative_time(timed.time, run)} s  {change.author}  {change.action}")]
            shown = details if arguments.all else details[:_MAX_LINES]
            lines += [screen.fitted(f"    {line}") for line in shown]
            lines += [f"    {len(details) - len(shown)} more: --all"] if len(shown) < len(details) else []
            data.append(_change_json(timed))
    return CommandResult(lines or ["no changes"], data)


def _change_lines(scene: Scene, timed: TimedChange) -> list[str]:
    """Returns the lines of a change, and applies it to the scene."""
    change = timed.change
    ids = [e.id for e in change.elements]
    if change.action == RESET:
        apply_change(scene, change)
        return [f"the whole scene, {len(ids)} elements"]
    facts = [(r["src"], r["dst"]) for part in (change, *change.elements) for r in _relations(part)]
    facts += [(src, dst) for eid in ids for src, _, dst in scene.relations(dst=eid)]
    touched = dict.fromkeys([*ids, *(end for fact in facts for end in fact if end != "-1")])
    before = _elements(scene, touched)
    apply_change(scene, change)
    after = _elements(scene, touched)
    return changed_lines(difference(before, after)) or [summary(change)]


def _relations(part: Change | Element) -> Iterable[RelationDict]:
    return part.relations if isinstance(part, Change) else part.relation_view


def _elements(scene: Scene, ids: Iterable[str]) -> list[Element]:
    return [element for eid in ids if (element := scene.element(eid)) is not None]


def _change_json(timed: TimedChange) -> dict[str, Any]:
    change = timed.change
    return {
        "time": timed.time,
        "gap": timed.gap,
        "author": change.author,
        "action": change.action,
        "snapshot_id": change.snapshot_id,
        "elements": [element_json(e) for e in change.elements],
        "relations": [{"src": r["src"], "type": r["type"], "dst": r["dst"]} for r in change.relations],
    }


def restore(run: Run, arguments: argparse.Namespace, screen: Screen) -> CommandResult:
    """Replaces the scene of a running world model by the scene of the bag at a time, in one transaction."""
    from skiros2_world_model.command_line.program import connect  # takes a second to import, and needs ROS

    at = parse_time(arguments.at, run) if arguments.at else run.end
    scene = run.world(at, arguments.partial)
    done = restore_scene(connect(arguments.wm, user()), scene)
    counts = f"{done.added} added, {done.changed} changed, {done.removed} removed"
    text = f"the scene is as at {relative_time(at, run)} s: {counts}"
    return CommandResult([screen.fitted(text)], asdict(done))


#: Maximum number of differences to print without `--all`.
_MAX_ROWS = 20


def diff(run: Run, arguments: argparse.Namespace, screen: Screen) -> CommandResult:
    """Compares a run with another one: the first divergence, then all differences."""
    if not 0 <= arguments.tolerance < math.inf:
        raise UsageError(f"--tolerance {arguments.tolerance}: expected a number of at least 0")
    other = Run.open(arguments.other)
    found = diff_runs(run, other, Tolerance(arguments.tolerance, arguments.tolerance))
    if not found:
        return CommandResult(["the runs are alike"], [])
    shown = found if arguments.all else found[:_MAX_ROWS]
    lines = ["first divergence:", *_difference_lines(found[0], screen)]
    if len(found) > 1:
        lines += ["", "all differences:"]
        lines += [f"  {line}" for line in table(screen, map(_row, shown), ("at s", "what", "where", "expected", "got"))]
        lines += [f"  {len(found) - len(shown)} more: --all"] if len(shown) < len(found) else []
    return CommandResult(lines, [asdict(difference) for difference in found], REFUSED)


def _difference_lines(difference: Difference, screen: Screen) -> list[str]:
    lines = [f"at {difference.time:.2f} s, {difference.kind}: {difference.where}"]
    lines += [f"expected: {difference.expected}"] if difference.expected else []
    return [screen.fitted(f"  {line}") for line in [*lines, f"got:      {difference.got}"]]


def _row(difference: Difference) -> tuple[str, ...]:
    time = "" if difference.kind == Kind.SCENE else f"{difference.time:.2f}"
    return time, difference.kind, difference.where, difference.expected, difference.got


#: Numbers from here on are s since the epoch (1973); smaller numbers are s since the start of the bag.
_ABSOLUTE = 1e8


def parse_time(text: str, run: Run) -> float:
    """Returns the time that a text denotes (s since the epoch).

    `12.5` is 12.5 s after the start of the bag, `-3` is 3 s before its end, `2026-11-21 14:05:30` is a local time,
    `1795233085.4` is s since the epoch.

    :raises WrongValue: the text has none of these forms.
    """
    try:
        number = float(text)
    except ValueError:
        with contextlib.suppress(ValueError, OverflowError):
            return datetime.fromisoformat(text.strip()).timestamp()
        number = math.nan
    if not math.isfinite(number):
        raise WrongValue(
            f"{text!r} is not a time: expected s after the start (12.5), before the end (-3) or '2026-11-21 14:05:30'"
        )
    if number >= _ABSOLUTE:
        return number
    return run.end + number if text.strip().startswith("-") else run.start + number


def relative_time(at: float, run: Run) -> str:
    """Formats a time as s after the start of the bag."""
    return f"{at - run.start:.2f}"


def local_time(at: float) -> str:
    """Formats a time as local date and time."""
    return time.strftime("%Y-%m-%d %H:%M:%S", time.localtime(at))
