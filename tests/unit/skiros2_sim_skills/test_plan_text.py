"""Plans as text."""

import pytest

from skiros2_common.core.errors import WrongValue
from skiros2_demo.run_check import plan_lines, steps_of
from support.recorded_run import PLAN, PRODUCT, TRAY_B

NAMES = {PRODUCT: "Product A", TRAY_B: "Tray B"}


def test_plan_has_one_numbered_line_per_step() -> None:
    assert plan_lines(steps_of(PLAN), lambda i: NAMES.get(i, i)) == [
        "1. pick     Object: Product A",
        "2. place    Container: Tray B",
    ]


def test_empty_text_has_no_steps() -> None:
    assert steps_of("") == []


@pytest.mark.parametrize("text", ["{", "{}x", "5", "[{}]", '[{"number": "1"}]', "[5]"])
def test_invalid_plan_is_rejected(text: str) -> None:
    with pytest.raises(WrongValue, match="the plan cannot be read"):
        steps_of(text)
