"""The commands `show`, `check`, `tasks`, `skills` and `plot`."""

from __future__ import annotations

import argparse
from collections import Counter, defaultdict
from collections.abc import Iterable
from typing import Any

from skiros2_bags.core.checking import check
from skiros2_bags.core.message import MONITOR, PROGRESS
from skiros2_bags.core.run import Run
from skiros2_bags.core.task_run import FAILURE, STATES, SUCCESS, SkillRun, TaskRun
from skiros2_bags.core.times import local_time, relative_time
from skiros2_common.command_line.command import REFUSED, CommandResult
from skiros2_common.command_line.layout import Branch, Screen, table, tree
from skiros2_common.core.names import local_name

_SYMBOLS = {SUCCESS: ("✓", "+"), FAILURE: ("✗", "x")}


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
    skills = ", ".join(node.name for node in task.nodes.values() if node.depth == 1)
    state = STATES.get(task.root.state, "") if task.has_ended else "not ended"
    outcome = state if task.message == state or not task.message else f"{state}: {task.message}"
    return relative_time(task.start, run), f"{task.end - task.start:.2f}", task.robot, str(task.id), skills, outcome


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
            {"robot": t.robot, "task": t.id, "start": t.start, "end": t.end, "ended": t.has_ended,
             "state": STATES.get(t.root.state), "message": t.message}
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
        if _matches_robot(task.robot, arguments.robot) and arguments.task in (None, task.id)
    ]
    lines: list[str] = []
    for task in selected:
        title = f"{task.robot}, task {task.id}: {relative_time(task.start, run)} to {relative_time(task.end, run)} s"
        lines += [
            "",
            screen.fitted(f"{title}{'' if task.has_ended else ', not ended'}"),
            *_task_tree(task, run, screen),
        ]
    return CommandResult(lines[1:] or ["no tasks"], lambda: [_task_json(task) for task in selected])


def _task_tree(task: TaskRun, run: Run, screen: Screen) -> list[str]:
    branches: dict[int, Branch] = {}
    for node in task.nodes.values():
        states = node.state_changes()
        marks = " ".join(_symbol(s.state, screen) for s in states)
        began = next((s.time for s in states if STATES.get(s.state) != "Idle"), None)
        ended = next((s.time for s in reversed(states) if s.state in (SUCCESS, FAILURE)), None)
        times = [relative_time(t, run) if t is not None else "" for t in (began, ended)]
        branch = Branch([f"{node.name} {node.processor}".strip(), marks, *times, node.states[-1].message])
        branches[node.id] = branch
        parent = branches.get(node.parent_id)
        if parent is not None and node.depth:
            parent.branches.append(branch)
    return tree(screen, [branches[task.id]])


def _symbol(state: int, screen: Screen) -> str:
    known = _SYMBOLS.get(state)
    if known is not None:
        return known[not screen.fancy]
    return {"Running": "r", "Idle": "."}.get(STATES.get(state, ""), "?")


def _task_json(task: TaskRun) -> dict[str, Any]:
    return {
        "robot": task.robot,
        "task": task.id,
        "start": task.start,
        "end": task.end,
        "nodes": [
            {
                "id": node.id, "parent": node.parent_id, "type": node.type, "label": node.label,
                "processor": node.processor,
                "states": [
                    {"time": s.time, "state": STATES.get(s.state, s.state), "code": s.code, "message": s.message}
                    for s in node.states
                ],
            }
            for node in task.nodes.values()
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
        lines = table(screen, _total_rows(selected), ("skill", "runs", "failed", "mean s", "least", "most", "sum s"))
    else:
        headers = ("skill", "robot", "task", "at s", "took s", "state", "message")
        lines = table(screen, [_skill_row(s, run) for s in selected], headers)
    return CommandResult(lines if selected else ["no skills"], lambda: [_skill_json(s) for s in selected])


def _skill_row(skill: SkillRun, run: Run) -> tuple[str, ...]:
    name = "  " * (skill.depth - 1) + skill.label
    times = relative_time(skill.start, run), f"{skill.duration:.2f}"
    return name, skill.robot, str(skill.task_id), *times, skill.state_name, skill.message


def _total_rows(selected: Iterable[SkillRun]) -> Iterable[tuple[str, ...]]:
    runs: dict[str, list[SkillRun]] = defaultdict(list)
    for skill in selected:
        runs[skill.label].append(skill)
    for label, found in sorted(runs.items(), key=lambda item: -sum(s.duration for s in item[1])):
        times = [s.duration for s in found]
        failed = sum(s.state == FAILURE for s in found)
        numbers = (sum(times) / len(times), min(times), max(times), sum(times))
        yield label, str(len(found)), str(failed or ""), *(f"{number:.2f}" for number in numbers)


def _skill_json(skill: SkillRun) -> dict[str, Any]:
    return {
        "robot": skill.robot, "task": skill.task_id, "node": skill.node_id, "depth": skill.depth, "label": skill.label,
        "type": skill.type, "start": skill.start, "end": skill.end, "state": skill.state_name, "code": skill.code,
        "message": skill.message,
    }  # fmt: skip


def _matches_robot(robot: str, wanted: str) -> bool:
    return not wanted or robot.strip("/") == wanted.strip("/") or local_name(robot) == wanted


def plot(run: Run, arguments: argparse.Namespace, screen: Screen) -> CommandResult:
    """Draws a PNG of the skill runs by robot and of the changes of the world model."""
    from skiros2_bags.core.gantt import save_gantt  # imports in a second

    output = arguments.output or run.path.with_suffix(".png")
    save_gantt(run, output, arguments.depth)
    return CommandResult([str(output)], {"file": str(output)})
