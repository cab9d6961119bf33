"""What is said beside the button that starts a skill: what it would run with, or why it would not run."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from skiros2_common.core.explanation import Explanation
from skiros2_gui.core.skills_presenter import SkillsPresenter
from skiros2_gui.core.skills_trial import Trial
from skiros2_task.core.actions import ROBOT_KEY

READY, REFUSED, WAITING = "ready", "refused", "waiting"


@dataclass(frozen=True)
class Verdict:
    """
    :param mood: `READY`, `REFUSED` or `WAITING`.
    :param text: in a sentence.
    :param details: more of it, in lines.
    """

    mood: str
    text: str
    details: tuple[str, ...] = ()


def verdict(skills: SkillsPresenter) -> Verdict:
    """What is to be said of the chosen skill."""
    form = skills.form
    if form is None:
        return Verdict(WAITING, "Choose a skill on the left.")
    if skills.is_starting:
        return Verdict(WAITING, f"Starting {form.offer.name}…")
    if skills.refused is not None:
        why = skills.refused.explanation
        first, *more = _without_author(skills.refused.text).strip().splitlines() or [""]
        return Verdict(REFUSED, f"Refused: {first}", tuple(_lines(why)) if why else tuple(more))
    if not skills.is_offered:
        return Verdict(REFUSED, f"{form.offer.manager} does not offer {form.offer.name} now.")
    if form.errors:
        told = "; ".join(f"{key}: {error}" for key, error in form.errors.items())
        return Verdict(REFUSED, f"Fill in first: {told}")
    if skills.trial is None and not skills.has_world:
        return Verdict(WAITING, "The world model is not there: it cannot be told whether it would start.")
    if skills.trial is None:
        return Verdict(WAITING, "Looking at the scene…")
    return _of_trial(skills.trial)


def _of_trial(trial: Trial) -> Verdict:
    if trial.problem:
        return Verdict(REFUSED, f"It cannot be told whether it would start: {trial.problem}")
    if trial.refusal is not None:
        return Verdict(REFUSED, f"It would be refused: {_headline(trial.refusal)}", tuple(_lines(trial.refusal)))
    found = [f"{key} = {choice.label or choice.id}" for key, choice in sorted(trial.values.items()) if key != ROBOT_KEY]
    text = f"Ready. The robot would take {', '.join(found)}." if found else "Ready."
    if trial.unchecked:
        text += f" Only the robot can check: {', '.join(trial.unchecked)}."
    return Verdict(READY, text)


def _headline(refusal: Explanation) -> str:
    """Why it would be refused, short."""
    if refusal.candidates:
        emptied = [c for c in refusal.candidates if c.emptied]
        keys = " and ".join(c.key for c in emptied or refusal.candidates)
        wanted = " together" if not emptied and len(refusal.candidates) > 1 else ""
        return f"no element of the scene fits {keys}{wanted}."
    if refusal.findings:
        return f"{'; '.join(f'{f.label}: {f.found}' for f in refusal.findings)}."
    if refusal.tried:
        reasons = dict.fromkeys(_headline(tried) for tried in refusal.tried)
        return " ".join(reasons)
    return refusal.message


def _lines(explanation: Explanation) -> Iterator[str]:
    """An explanation beyond its message."""
    for finding in explanation.findings:
        yield from finding.lines()
    yield from map(str, explanation.candidates)
    for tried in explanation.tried:
        yield f"{tried.label or tried.type}:"
        below = list(_lines(tried)) or tried.message.splitlines()
        yield from (f"  {line}" for line in below)


def _without_author(text: str) -> str:
    """The text of a refusal without who asked for it, which is this window."""
    head, mark, rest = text.partition(" refused: ")
    return rest if mark and head.startswith(("start by", "tick_once by")) else text
