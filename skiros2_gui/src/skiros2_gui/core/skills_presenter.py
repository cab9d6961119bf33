"""The tab "Skills" without its widgets: which skills there are, the chosen one and its parameters, starting it."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from skiros2_common.core.errors import SkirosError
from skiros2_common.core.explanation import Explanation
from skiros2_gui.core.events import ManagersChanged, TaskStarted, WorldChanged
from skiros2_gui.core.pace import Pace
from skiros2_gui.core.problems import in_words
from skiros2_gui.core.skills_catalogue import Offer, RobotRow, offers_of, rows_of
from skiros2_gui.core.skills_fields import Field, Way
from skiros2_gui.core.skills_form import Form
from skiros2_gui.core.skills_running import SkillsRunning
from skiros2_gui.core.skills_trial import Trial, try_start
from skiros2_gui.core.window import Window
from skiros2_skill.command_line.description import Skill

#: What the jobs that look how a start would go have to themselves.
_LANE = "skills: look"

_MOST_USES = 1_000_000


@dataclass(frozen=True)
class Refused:
    """A start that did not come off.

    :param text: what the manager said.
    :param explanation: why, where it tells.
    """

    text: str
    explanation: Explanation | None = None


class SkillsPresenter:
    """Holds what the tab shows. In the window's thread.

    `on_rows`, `on_form`, `on_trial` are called when the tree of skills, the form, and what would come of a start are
    other than before; the view sets them.
    """

    def __init__(self, window: Window) -> None:
        self._window = window
        self.running = SkillsRunning(window)
        self.on_rows: Callable[[], None] = _nothing
        self.on_form: Callable[[], None] = _nothing
        self.on_trial: Callable[[], None] = _nothing
        self.search = ""
        self.uses: dict[str, int] = {}
        self.form: Form | None = None
        self.trial: Trial | None = None
        self.refused: Refused | None = None
        self.is_starting = False
        self._stops = False  # what is being started is to be stopped
        self._offered: dict[str, list[Skill]] = {}
        self._offers: dict[tuple[str, str, str], Offer] = {}
        self._forms: dict[tuple[str, str, str], Form] = {}
        self._is_stale = False  # what would come of a start may be other by now
        self._is_edited = False  # so that it has to be looked at once
        self._is_looking = False
        self._pace = Pace()
        window.subscribe(ManagersChanged, lambda _: self.load())
        window.subscribe(WorldChanged, self._world_changed)
        self.load()

    # -- which skills there are --------------------------------------------------------------------------------

    @property
    def rows(self) -> tuple[RobotRow, ...]:
        """The tree, as the search leaves it."""
        return rows_of(self._offered, self.uses, self.search)

    def load(self) -> None:
        """Asks all managers for their skills. Those that are gone are left out at once."""
        managers = self._window.system.managers
        self._offered = {name: skills for name, skills in self._offered.items() if name in managers}
        for name, manager in managers.items():
            self._window.jobs.run(
                manager.skills,
                lambda skills, name=name: self._take(name, skills),  # type: ignore[misc]
                what=f"reading the skills of {name}",
                lane=name,
            )
        self._show_rows()

    def _take(self, name: str, skills: list[Skill]) -> None:
        if name in self._window.system.managers:
            self._offered[name] = skills
            self._show_rows()

    def _show_rows(self) -> None:
        self._offers = {offer.key: offer for offer in offers_of(rows_of(self._offered, {}))}
        self.on_rows()
        chosen = self.form.offer if self.form is not None else None
        if chosen is None:
            return
        known = self._find(chosen.key)
        if known is not None and known != chosen:
            self.choose(known.key)
        elif known is None:
            self._outdate()

    def search_for(self, text: str) -> None:
        """Leaves in the tree what has these words."""
        if text != self.search:
            self.search = text
            self.on_rows()

    # -- the chosen skill --------------------------------------------------------------------------------------

    @property
    def is_offered(self) -> bool:
        """Whether the robot of the chosen skill is there and offers it."""
        return self.form is not None and self._find(self.form.offer.key) is not None

    def choose(self, key: tuple[str, str, str] | None) -> None:
        """Shows the parameters of a skill, with what was filled in when it was shown last."""
        offer = self._find(key) if key is not None else None
        if offer is None:
            self.form = None
        elif self.form is None or self.form.offer != offer:
            before = self._forms.get(offer.key)
            self.form = self._forms[offer.key] = Form(offer)
            if before is not None:
                self.form.adopt(before)
        else:
            return
        self.trial, self.refused = None, None
        self.on_form()
        self._outdate()
        self.look()

    def _find(self, key: tuple[str, str, str]) -> Offer | None:
        return self._offers.get(key)

    def write(self, key: str, text: str) -> None:
        """Something was typed into an editor."""
        self._edit(key, lambda field: field.write(text))

    def choose_value(self, key: str, value: Any) -> None:
        """An element, by its id, or yes or no was chosen."""
        self._edit(key, lambda field: field.choose(value))

    def take_way(self, key: str, way: Way) -> None:
        """The parameter is to be inferred, or unset, or given."""
        self._edit(key, lambda field: field.take(way))

    def reset(self) -> None:
        """All parameters as the skill declares them."""
        if self.form is not None:
            self.form.reset()
            self.refused = None
            self.on_form()
            self._outdate()
            self.look()

    def _edit(self, key: str, change: Callable[[Field], None]) -> None:
        field = self.form.fields.get(key) if self.form is not None else None
        if field is not None:
            change(field)
            self.refused = None
            self._outdate()
            self.look()

    # -- what would come of a start ----------------------------------------------------------------------------

    def _world_changed(self, _: WorldChanged) -> None:
        self._is_stale = True  # what is shown stays until it was looked anew

    def _outdate(self) -> None:
        self._is_stale = self._is_edited = True
        self.on_trial()

    def look_again(self) -> None:
        """As `look`, for the view to call now and then: a scene that always changes is not looked at each time."""
        if self._pace.is_rested:
            self.look()

    def look(self) -> None:
        """Finds out what would come of a start, where that may be other than it was."""
        form, world = self.form, self._window.system.world
        if not self._is_stale or self._is_looking or form is None or world is None:
            return
        self._is_stale = self._is_edited = False
        given = form.given()
        self._is_looking = True
        self._pace.begin()
        self._window.jobs.run(
            lambda: try_start(form.offer, given, form.classes, world),
            lambda trial: self._looked(form, trial),
            lambda error: self._looked(form, Trial(problem=in_words(error))),
            lane=_LANE,
        )

    def _looked(self, form: Form, trial: Trial) -> None:
        self._is_looking = False
        self._pace.end()
        if form is self.form:
            self.trial = trial
            self.on_trial()
        if self._is_edited:
            self.look()

    # -- starting ----------------------------------------------------------------------------------------------

    @property
    def has_world(self) -> bool:
        """Whether there was a world model yet."""
        return self._window.system.world is not None

    @property
    def can_start(self) -> bool:
        """Whether there is something to be sent; what would be refused may be sent too."""
        return self.form is not None and not self.form.errors and self.is_offered and not self.is_starting

    def start(self, ticks_once: bool = False) -> None:
        """Starts the chosen skill as a task of its own.

        :param ticks_once: it is ticked once and paused.
        """
        form = self.form
        if form is None or not self.can_start:
            return
        offer = form.offer
        manager = self._window.system.managers[offer.manager]
        step = form.step()
        action = "tick_once" if ticks_once else "start"
        self.is_starting, self._stops, self.refused = True, False, None
        since = self.running.now()
        self.on_trial()
        self._window.jobs.run(
            lambda: _start(manager, action, step),
            lambda came: self._started(form, came, since),
            lambda error: self._started(form, Refused(in_words(error)), since),
            what=f"starting {offer.name} of {offer.manager}",
        )

    def _started(self, form: Form, came: int | Refused, since: float) -> None:
        self.is_starting = False
        offer = form.offer
        if isinstance(came, int):
            self.uses[offer.use] = min(self.uses.get(offer.use, 0) + 1, _MOST_USES)
            self.running.started(offer.manager, came, offer.name, since)
            self._window.tell(TaskStarted(offer.manager, came))
            if self._stops:
                self.running.stop((offer.manager, came))
        elif form is self.form:
            self.refused = came
        else:
            self._window.problems.tell(f"starting {offer.name} of {offer.manager}", came.text)
        self.on_trial()

    def toggle(self) -> None:
        """Stops what was started last, of the chosen skill's robot; when that has ended, starts the chosen skill. A
        start that is under way is stopped when the task's id is known."""
        if self.is_starting:
            self._stops = True
            return
        manager = self.form.offer.manager if self.form is not None else ""
        last = self.running.last_of(manager)
        if last is not None and not last.is_over:
            self.running.stop(last.key)
        else:
            self.start()

    # -- settings ----------------------------------------------------------------------------------------------

    def settings(self) -> dict[str, Any]:
        """What is to be kept, as JSON has it."""
        return {"uses": self.uses}

    def restore(self, settings: Mapping[str, Any]) -> None:
        """Takes what `settings` gave; what is not as expected is left out."""
        uses = settings.get("uses")
        if isinstance(uses, Mapping):
            counts = {k: n for k, n in uses.items() if isinstance(k, str) and type(n) is int and 0 < n <= _MOST_USES}
            self.uses = counts
        self.on_rows()


def _start(manager: Any, action: str, step: Any) -> int | Refused:
    """Sends a skill; in a worker. What the manager says against it is an answer too."""
    try:
        return int(manager.command(action, -1, [step]))
    except SkirosError as error:
        return Refused(str(error), _why_refused(manager, str(error)))


def _why_refused(manager: Any, text: str) -> Explanation | None:
    """What the manager tells of the start that it has just refused; None when it tells of something else."""
    try:
        told = json.loads(manager.why(-1).json or "[]")
        explanation = Explanation.from_dict(told[-1]) if told else None
    except (SkirosError, ValueError):
        return None
    return explanation if explanation is not None and explanation.message in text else None


def _nothing() -> None:
    """Nobody looks."""
