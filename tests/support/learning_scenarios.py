"""Texts of small learning scenarios, with executions of `support.learning_tasks`."""

from __future__ import annotations


def scenario_text(
    name: str,
    execution: str,
    variables: str = "x",
    *,
    evaluations: int,
    initial: int,
    repetitions: int = 2,
    seed: int = 3,
    **sections: str,
) -> str:
    """Returns a scenario that minimises the objective `cost`.

    :param execution: of `support.learning_tasks`.
    :param variables: their names, one letter each; they are real, from 0 to 1.
    :param sections: others, as YAML.
    """
    lines = [
        f"scenario: {name}",
        f"execution: support.learning_tasks:{execution}",
        "variables:",
        *(f"  {each}: {{type: real, range: [0, 1]}}" for each in variables),
        "objectives:",
        "  cost: {sense: minimise, rewards: [{reward: signal, series: value}]}",
        f"budget: {{evaluations: {evaluations}, initial: {initial}}}",
        f"repetitions: {repetitions}",
        f"seed: {seed}",
        *(f"{key}: {text}" for key, text in sections.items()),
    ]
    return "\n".join(lines) + "\n"
