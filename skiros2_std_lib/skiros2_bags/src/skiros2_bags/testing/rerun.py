"""Deterministic re-run: the trees of a recording are ticked again in this process, from the recording alone.

Each message of progress stands for a tick. Before it, what came before it in the bag is played: changes of the world
model by others, answers of action servers, cancellations, the clock. After it the tree has to be as it was told then,
and at the end the world model has to have had the same changes.

Of two things that came within `WINDOW` of each other, and of the time within a tick, a bag does not tell exactly which
was first. Where that matters the recording has gone the other way than the order in the bag: both are tried.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

from skiros2_bags.core.errors import BagError
from skiros2_bags.testing.divergence import Divergence
from skiros2_bags.testing.kinds import Settings
from skiros2_bags.testing.recording import Acted, Changed, Event, Recording, Ticked, Told
from skiros2_bags.testing.rerun_process import Rerun
from skiros2_bags.testing.task_runs import TaskRun, task_runs

#: How far apart in the bag two messages may be whose order is not certain (s).
WINDOW = 0.02

#: How far off the time of a tick may be (s); in simulated time a step of the clock more.
JITTER = 0.005

#: So many ways to read a bag are tried at most.
ATTEMPTS = 60


@dataclass(frozen=True)
class Reading:
    """How the uncertain parts of a bag are taken.

    :param places: orders of messages, and where they are put instead.
    :param shifts: orders of progress messages, and how much their ticks are moved in time (s).
    """

    places: tuple[tuple[int, float], ...] = ()
    shifts: tuple[tuple[int, float], ...] = ()


def rerun(recording: Recording, settings: Settings) -> Divergence | None:
    """Runs all tasks of a recording again. None: all went as recorded.

    :raises BagError: the bag has not what that takes.
    """
    runs = task_runs(recording)
    if not runs:
        raise BagError(f"{recording.path}: no progress of tasks; expected a topic /MANAGER/monitor")
    reading = Reading()
    best = _attempt(recording, runs, settings, reading)
    attempts = 1
    while best is not None and attempts < ATTEMPTS:
        for other in _other_readings(recording, reading, best[0]):
            attempts += 1
            found = _attempt(recording, runs, settings, other)
            if found is None:
                return None
            if found[0].order > best[0].order:
                best, reading = found, other
                break
            if attempts >= ATTEMPTS:
                break
        else:
            break
    return best[1] if best is not None else None


def _attempt(
    recording: Recording, runs: list[TaskRun], settings: Settings, reading: Reading
) -> tuple[Event, Divergence] | None:
    """The first event after which all was not as recorded."""
    places = dict(reading.places)
    events = sorted(recording.events, key=lambda e: places.get(e.order, e.order))
    with Rerun(recording, runs, settings.workspace, settings.played, settings.tolerance, dict(reading.shifts)) as run:
        for event in events:
            divergence = run.play(event)
            if divergence is not None:
                return event, divergence
        divergence = run.end()
    return (replace(events[-1], order=math.inf), divergence) if divergence is not None else None  # type: ignore[arg-type]


def _other_readings(recording: Recording, reading: Reading, at: Event) -> Iterator[Reading]:
    """Other ways to read the bag near an event, the likely ones first."""
    if not isinstance(at, Told):
        return
    near = [e for e in recording.events if abs(e.time - at.time) <= WINDOW and _is_input(e)]
    near.sort(key=lambda e: abs(e.order - at.order))
    moved = dict(reading.places)
    for event in near:
        if event.order not in moved:
            place = at.order + 0.5 if event.order < at.order else at.order - 0.5
            yield replace(reading, places=(*reading.places, (event.order, place)))
    if at.order not in dict(reading.shifts):
        step = JITTER + _clock_step(e for e in recording.events if isinstance(e, Ticked))
        for shift in (step, -step):
            yield replace(reading, shifts=(*reading.shifts, (at.order, shift)))


def _is_input(event: Event) -> bool:
    return isinstance(event, Changed) or (isinstance(event, Acted) and event.part == "cancel")


def _clock_step(ticks: Iterable[Ticked]) -> float:
    """How far apart two messages of the clock are (s)."""
    times = [tick.now for tick, _ in zip(ticks, range(100), strict=False)]
    steps = sorted(b - a for a, b in itertools.pairwise(times))
    return steps[len(steps) // 2] if steps else 0.0
