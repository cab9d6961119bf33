"""The status beside the start button: what the skill would run with, or why it would not run."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from skiros2_common.core.explanation import Explanation
from skiros2_common.core.names import local_name
from skiros2_common.core.wording import label_text
from skiros2_gui.skills.presenter import Preview, SkillsPresenter
from skiros2_task.core.actions import ROBOT_KEY

READY, REFUSED, WAITING = "ready", "refused", "waiting"


@dataclass(frozen=True)
class StartStatus:
    """:param status: `READY`, `REFUSED` or `WAITING`.
    :param text: one sentence.
    :param details: more lines.
    """

    status: str
    text: str
    details: tuple[str, ...] = ()


def start_status(skills: SkillsPresenter) -> StartStatus:
    """Returns the status of the chosen skill, with names instead of ids."""
    found, readable = _status(skills), skills.names.readable
    return StartStatus(found.status, readable(found.text), tuple(map(readable, found.details)))


def _status(skills: SkillsPresenter) -> StartStatus:
    form = skills.form
    if form is None:
        return StartStatus(WAITING, "Choose a skill on the left.")
    if skills.is_starting:
        return StartStatus(WAITING, f"Starting {form.offer.name}…")
    if skills.refused is not None:
        why = skills.refused.explanation
        first, *more = (why.message if why else skills.refused.text).strip().splitlines() or [""]
        return StartStatus(REFUSED, f"Refused: {first}", tuple(_lines(why)) if why else tuple(more))
    if not skills.is_offered:
        return StartStatus(REFUSED, f"{form.offer.manager} does not offer {form.offer.name} now.")
    if form.errors:
        errors = "; ".join(f"{key}: {error}" for key, error in form.errors.items())
        return StartStatus(REFUSED, f"Fill in first: {errors}")
    if skills.preview is None:
        return StartStatus(WAITING, "Asking the robot…")
    return _of_preview(skills.preview)


def _of_preview(preview: Preview) -> StartStatus:
    start = preview.start
    if start is None:
        return StartStatus(REFUSED, f"The start cannot be previewed: {preview.problem}")
    if start.refusal is not None:
        text = f"It would be refused: {_headline(start.refusal)}"
        return StartStatus(REFUSED, text, tuple(_lines(start.refusal)))
    elements = sorted((key, element) for key, element in start.elements.items() if key != ROBOT_KEY)
    found = [f"{key} = {label_text(element.label) or local_name(element.id)}" for key, element in elements]
    return StartStatus(READY, f"Ready. The robot would use {', '.join(found)}." if found else "Ready.")


def _headline(refusal: Explanation) -> str:
    """Returns the short reason of a refusal."""
    if refusal.candidates:
        emptied = [c for c in refusal.candidates if c.emptied]
        keys = " and ".join(c.key for c in emptied or refusal.candidates)
        together = " together" if not emptied and len(refusal.candidates) > 1 else ""
        return f"no element of the scene matches {keys}{together}."
    if refusal.findings:
        return f"{'; '.join(f'{f.label}: {f.found}' for f in refusal.findings)}."
    if refusal.tried:
        reasons = dict.fromkeys(_headline(tried) for tried in refusal.tried)
        return " ".join(reasons)
    return refusal.message


def _lines(explanation: Explanation) -> Iterator[str]:
    """Yields an explanation without its message."""
    for finding in explanation.findings:
        yield from finding.lines()
    yield from map(str, explanation.candidates)
    for tried in explanation.tried:
        yield f"{tried.label or tried.type}:"
        below = list(_lines(tried)) or tried.message.splitlines()
        yield from (f"  {line}" for line in below)
