"""Which skills, conditions and branches recorded runs have exercised."""

from __future__ import annotations

import json

import pytest

from skiros2_bags.command_line.coverage import main
from skiros2_bags.core.coverage import Coverage, Outcomes
from skiros2_bags.core.run import Run
from support.ros import ROOT

BAGS = ROOT / "tests" / "bags"


@pytest.fixture(scope="module")
def engine() -> Coverage:
    coverage = Coverage()
    coverage.add(Run.open(BAGS / "engine.bag"))
    return coverage


def test_outcomes_of_skills_are_counted(engine: Coverage) -> None:
    assert engine.skills["fail_twice"].outcomes == Outcomes(good=1, bad=1)  # two failures within one tick
    assert engine.skills["wait"].outcomes.preempted == 2
    assert engine.skills["watched_run"].outcomes == Outcomes(bad=1)


def test_conditions_are_counted_by_their_results(engine: Coverage) -> None:
    assert engine.skills["set_weight"].conditions == {"post-condition Heavy": Outcomes(good=3, bad=1)}
    assert engine.skills["watched_run"].conditions["hold-condition Light"] == Outcomes(good=1, bad=1)
    assert not engine.lacks_evidence


def test_branches_are_counted_below_their_skill(engine: Coverage) -> None:
    branches = engine.skills["engine_run"].branches
    assert branches["7 fallback ?", "1 set_weight"] == Outcomes(bad=1)
    assert branches["10 parallel |fs|", "2 wait"] == Outcomes(preempted=1)


def test_several_bags_add_up_and_the_package_shows_what_none_has_run(capsys: pytest.CaptureFixture[str]) -> None:
    bags = [str(BAGS / name) for name in ("timed_pick_place.bag", "timed_unmet.bag")]
    assert main([*bags, "skiros2_demo_skills", "--json"]) == 0
    skills = json.loads(capsys.readouterr().out)
    assert skills["pick"]["outcomes"] == {"good": 1, "bad": 1, "preempted": 0}
    assert skills["drive"]["conditions"]["post-condition RobotAtTarget"] == {"good": 2, "bad": 0, "preempted": 0}
    assert "wait" not in skills  # of another package
    assert main(bags) == 0
    printed = capsys.readouterr().out
    assert "never unsatisfied" in printed and "evidence" not in printed


def test_bag_without_evidence_is_named(capsys: pytest.CaptureFixture[str]) -> None:
    assert main([str(BAGS / "timed_goal.bag")]) == 0
    assert "a bag has no evidence of conditions" in capsys.readouterr().out


def test_wrong_names_are_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["skiros2_demo_skills"]) == 2
    assert "no bag is given" in capsys.readouterr().err
    assert main([str(BAGS / "timed_goal.bag"), "no_such_package"]) == 2
    assert "no_such_package cannot be imported" in capsys.readouterr().err
