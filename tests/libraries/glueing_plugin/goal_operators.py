"""A goal operator."""

from skiros2_task.core.goal_text import ParsedJunction, ParsedNot, add_goal_operator


def _either(parts):
    if len(parts) != 2:
        raise ValueError(f"expected two goals, got {len(parts)}")
    one, other = parts
    both = ParsedJunction(True, (one, other))
    return ParsedJunction(True, (ParsedJunction(False, (one, other)), ParsedNot(both)))


add_goal_operator("either", _either)
