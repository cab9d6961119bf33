"""Engines of unified-planning that misbehave, or can do little, each in a way of its own."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from typing import Any

from unified_planning.engines import Engine, PDDLPlanner, PlanGenerationResult, PlanGenerationResultStatus
from unified_planning.engines.mixins import OneshotPlannerMixin
from unified_planning.plans import ActionInstance, SequentialPlan
from up_fast_downward import FastDownwardPDDLPlanner


class _Bad(Engine, OneshotPlannerMixin):  # type: ignore[misc]
    """Claims to solve anything."""

    def __init__(self, **options: Any) -> None:
        Engine.__init__(self)
        OneshotPlannerMixin.__init__(self)

    @property
    def name(self) -> str:
        return type(self).__name__

    @staticmethod
    def supported_kind() -> Any:
        return None

    @staticmethod
    def supports(problem_kind: Any) -> bool:
        return True

    def _solve(self, problem: Any, *_: Any, **__: Any) -> Any:
        raise NotImplementedError


class Raising(_Bad):
    def _solve(self, problem: Any, *_: Any, **__: Any) -> Any:
        raise LookupError("out of luck")


class Dying(_Bad):
    def _solve(self, problem: Any, *_: Any, **__: Any) -> Any:
        os.kill(os.getpid(), signal.SIGKILL)


class Hanging(_Bad):
    """Does not look at its time, takes no signal, and starts a process in another session that does the same."""

    def _solve(self, problem: Any, *_: Any, **__: Any) -> Any:
        signal.signal(signal.SIGTERM, signal.SIG_IGN)
        subprocess.Popen([sys.executable, "-c", "import time; time.sleep(600)"], start_new_session=True)
        time.sleep(600)


class Wrong(_Bad):
    """Gives the first action that it finds, with the first objects."""

    def _solve(self, problem: Any, *_: Any, **__: Any) -> Any:
        action = problem.action("pick")
        last = [list(problem.objects(p.type))[-1] for p in action.parameters]
        plan = SequentialPlan([ActionInstance(action, last)])
        return PlanGenerationResult(PlanGenerationResultStatus.SOLVED_SATISFICING, plan, self.name)


class Printing(PDDLPlanner):  # type: ignore[misc]
    """A program that prints and writes garbage."""

    def __init__(self, **options: Any) -> None:
        super().__init__()

    @property
    def name(self) -> str:
        return "Printing"

    @staticmethod
    def supported_kind() -> Any:
        return None

    @staticmethod
    def supports(problem_kind: Any) -> bool:
        return True

    def _get_cmd(self, domain_filename: str, problem_filename: str, plan_filename: str) -> list[str]:
        program = f"print('\\x00\\xff rubbish'); open({plan_filename!r}, 'w').write('((( fly me\\n)')"
        return [sys.executable, "-c", program]

    def _result_status(self, *_: Any, **__: Any) -> Any:
        return PlanGenerationResultStatus.SOLVED_SATISFICING


class Flat(FastDownwardPDDLPlanner):  # type: ignore[misc]
    """Knows no types under others."""

    @staticmethod
    def supported_kind() -> Any:
        kind = FastDownwardPDDLPlanner.supported_kind()
        kind.unset_typing("HIERARCHICAL_TYPING")
        return kind

    @staticmethod
    def supports(problem_kind: Any) -> bool:
        return bool(problem_kind <= Flat.supported_kind())
