"""A planning engine."""

from collections import deque

from unified_planning.engines import Engine, PlanGenerationResult, PlanGenerationResultStatus
from unified_planning.engines.mixins import OneshotPlannerMixin
from unified_planning.engines.sequential_simulator import UPSequentialSimulator
from unified_planning.plans import ActionInstance, SequentialPlan


class BreadthFirst(Engine, OneshotPlannerMixin):
    """Searches all plans, the shortest first."""

    def __init__(self, **options):
        Engine.__init__(self)
        OneshotPlannerMixin.__init__(self)

    @property
    def name(self):
        return "breadth first"

    @staticmethod
    def supported_kind():
        return UPSequentialSimulator.supported_kind()

    @staticmethod
    def supports(problem_kind):
        return True

    def _solve(self, problem, *args, **kwargs):
        simulator = UPSequentialSimulator(problem, error_on_failed_checks=False)
        waiting = deque([(simulator.get_initial_state(), [])])
        while waiting:
            state, steps = waiting.popleft()
            if simulator.is_goal(state):
                plan = SequentialPlan([ActionInstance(action, params) for action, params in steps], problem.environment)
                return PlanGenerationResult(PlanGenerationResultStatus.SOLVED_SATISFICING, plan, self.name)
            for action, params in simulator.get_applicable_actions(state):
                waiting.append((simulator.apply(state, action, params), [*steps, (action, params)]))
        return PlanGenerationResult(PlanGenerationResultStatus.UNSOLVABLE_PROVEN, None, self.name)
