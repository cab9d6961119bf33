"""Variations of a task: parameters as functions of its features. With executions of support.learning_tasks."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Sequence
from pathlib import Path

import pytest

from skiros2_common.core.errors import ConfigurationError, Refused, WrongValue
from skiros2_learning.command_line.program import main
from skiros2_learning.core.evaluation import Outcome, evaluate
from skiros2_learning.core.policy import Policy, learn_variations, sampled_variations, variation_studies
from skiros2_learning.core.policy_table import applicable_policy, stored_policy, validate_policy
from skiros2_learning.core.scenario import Scenario, ScenarioError, load_scenario, parse_scenario
from skiros2_learning.core.study import LearningStudy
from skiros2_learning.core.validation import Execute, repeat_here
from skiros2_learning.local.episode import Episode, check_scenario
from skiros2_skill.testing import FakeClock
from support.learning_scenarios import scenario_text
from support.learning_tasks import moving_optimum

pytestmark = pytest.mark.timeout(300)

PUSH = Path(__file__).parents[3] / "skiros2_std_lib/demos/learning/scenarios/push.yaml"

TEXT = scenario_text(
    "moving_bowl", "moving_bowl", "xy", evaluations=9, initial=5, repetitions=1, seed=2,
    variations="{f: {range: [0, 1]}}",
)  # fmt: skip


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Eight variations, learned."""
    folder = tmp_path_factory.mktemp("policy")
    learn_variations(scenario(), folder, 8, run)
    return folder


def run(study: LearningStudy) -> None:
    """Uses up the budget in this process."""
    while study.counted < study.scenario.budget.evaluations:
        number, configuration, seed = study.ask()
        study.tell(number, evaluate(study.scenario, configuration, seed))


def scenario(text: str = TEXT) -> Scenario:
    return parse_scenario(text, Path())


@pytest.mark.parametrize("feature", [0.15, 0.35, 0.6, 0.85])
def test_parameters_of_an_unseen_variation_are_predicted_with_an_uncertainty(folder: Path, feature: float) -> None:
    studies = variation_studies(folder)
    assert all(abs(study.scenario.variation["f"] - feature) > 0.01 for study in studies)
    found = Policy(studies).predict({"f": feature})
    x, y = moving_optimum(feature)
    assert float(found.configuration["x"]) == pytest.approx(x, abs=0.06)
    assert float(found.configuration["y"]) == pytest.approx(y, abs=0.06)
    assert 0.0 < found.deviation < 1.0


def test_a_policy_is_validated_on_variations_that_no_study_has_seen(folder: Path) -> None:
    seen = []

    def repeat(scenario: Scenario, jobs: Sequence[Execute]) -> Iterator[Outcome]:
        seen.extend(job.variation["f"] for job in jobs if job.variation)
        return repeat_here()(scenario, jobs)

    studies = variation_studies(folder)
    found = validate_policy(studies, repeat)
    plan = found.validation.learned
    assert not {study.scenario.variation["f"] for study in studies} & set(seen)
    assert (plan.count, len(set(seen))) == (30, 40)
    assert [each.count for each in found.validation.candidates] == [10, 10, 10]
    regression, _, constant = found.validation.candidates
    assert plan.name == "the policy by regression"
    assert plan.success.low > 0.8
    assert constant.good < 5 < regression.good
    assert found.validation.defaults is None


def test_defaults_that_are_as_good_keep_a_policy_from_being_applied(tmp_path: Path) -> None:
    text = TEXT.replace("moving_bowl", "parabola").replace("  y: {type: real, range: [0, 1]}\n", "")
    plan = parse_scenario(text + "settings: {defaults: {x: 0.3}}\n", Path())
    studies = learn_variations(plan, tmp_path, 2, run)
    found = validate_policy(studies, repeat_here())
    assert found.validation.defaults is not None
    assert found.validation.defaults.good == 30
    with pytest.raises(Refused, match=r"no validated policy; run: learn validate"):
        applicable_policy(tmp_path)
    found.save(tmp_path)
    assert stored_policy(tmp_path) == found
    with pytest.raises(Refused, match="is not better with confidence than the defaults of the skill"):
        applicable_policy(tmp_path)
    assert applicable_policy(tmp_path, unvalidated=True) == found


def test_a_prediction_is_the_same_each_time(folder: Path) -> None:
    first, second = (Policy(variation_studies(folder)).predict({"f": 0.4}) for _ in range(2))
    assert first == second


def test_uncertainty_is_greater_far_from_the_learned_variations(tmp_path: Path) -> None:
    studies = []
    for number, feature in enumerate((0.0, 0.1, 0.2)):
        plan = scenario().derived(variation={"f": feature}, evaluations=8)
        studies.append(LearningStudy.create(plan, tmp_path / f"variation_{number}"))
        run(studies[-1])
    policy = Policy(studies)
    assert policy.predict({"f": 1.0}).deviation > policy.predict({"f": 0.1}).deviation


def test_variations_cover_the_range_and_are_the_same_each_time() -> None:
    values = [each["f"] for each in sampled_variations(scenario().variations, 8, seed=1)]
    assert sorted(int(value * 8) for value in values) == list(range(8))
    assert values == [each["f"] for each in sampled_variations(scenario().variations, 8, seed=1)]


def test_interrupted_variations_continue_and_later_ones_start_from_the_nearest(folder: Path) -> None:
    begun: list[int] = []
    studies = learn_variations(scenario(), folder, 8, lambda study: begun.append(study.counted))
    assert begun == [9] * 8
    assert studies[0].scenario.variables[0].prior is None
    assert all(study.scenario.variables[0].prior is not None for study in studies[1:])


def test_features_that_do_not_fit_are_reported(folder: Path) -> None:
    policy = Policy(variation_studies(folder))
    with pytest.raises(WrongValue) as found:
        policy.predict({"g": 0.5, "f": 2.0})
    assert "no feature is called 'g'" in str(found.value)
    assert "f: expected 0 to 1, got 2.0" in str(found.value)
    with pytest.raises(ScenarioError, match="variation: f: expected 0 to 1, got nan"):
        scenario(TEXT + "variation: {f: .nan}\n")
    with pytest.raises(ScenarioError, match=r"variations\.f\.range: expected the lower bound first"):
        scenario(TEXT.replace("f: {range: [0, 1]}", "f: {range: [1, 0]}"))
    with pytest.raises(Refused, match="at least two variations"):
        Policy(variation_studies(folder)[:1])


def test_a_scenario_without_variations_is_refused(tmp_path: Path) -> None:
    with pytest.raises(Refused, match="has no variations"):
        learn_variations(scenario(TEXT.replace("variations: {f: {range: [0, 1]}}\n", "")), tmp_path, 2, print)


def test_the_command_line_learns_variations_and_predicts_and_checks_another_one(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "bowl.yaml").write_text(TEXT)
    folder = str(tmp_path / "policy")
    command = ["variations", str(tmp_path / "bowl.yaml"), "--study", folder, "--count", "2", "--workers", "1"]
    assert main(command) == 0, capsys.readouterr().err
    printed = capsys.readouterr().out
    assert "predict others with: learn predict" in printed
    assert "policy for f 0 to 1, chosen from: the policy by regression (" in printed
    assert main(["validate", folder, "--workers", "1"]) == 0
    assert re.search(r"success \d+ of 30, 95 % interval", capsys.readouterr().out)
    assert main(["status", folder]) == 0
    assert re.search(r"f=\S+: success .*success \d+ of 30, 95 % interval", capsys.readouterr().out, re.DOTALL)
    assert main(["predict", folder, "f=0.5", "--check", "3", "--json"]) in (0, 1)  # two variations may be too few
    data = json.loads(capsys.readouterr().out)
    assert data["checked"]["configuration"] == data["configuration"]
    assert len(data["checked"]["repetitions"]) == 3
    assert main(["predict", folder, "f=high"]) == 1
    assert "'f=high': expected FEATURE=NUMBER" in capsys.readouterr().err
    assert main(["predict", str(tmp_path), "f=0.5"]) == 1
    assert "has no variations; learn them" in capsys.readouterr().err


def test_a_variation_moves_the_goal_in_the_world_model_and_in_the_world() -> None:
    push = load_scenario(PUSH).derived(variation={"goal_x": 0.51})
    with FakeClock() as clock, Episode(push, 1, 0, clock) as episode:
        assert episode.bench.element("Goal").value_of("skiros:PositionX") == 0.51
    feature = 'element: Goal, property: "skiros:PositionX", range: [0.5, 0.66]'
    text = PUSH.read_text().replace(feature, 'element: Block, property: "skiros:SizeX", range: [0.05, 0.09]')
    text += "\nvariation: {goal_x: 0.05}\n"
    with FakeClock() as clock, Episode(parse_scenario(text, PUSH.parent), 1, 0, clock) as episode:
        (block,) = (body for body in episode.draw.scene.bodies if body.label == "Block")
        assert block.size is not None
        assert block.size[0] == 0.05


def test_a_feature_that_the_scene_does_not_have_is_reported() -> None:
    text = PUSH.read_text().replace("skiros:PositionX", "skiros:PositionsX") + "\nvariation: {goal_x: 0.5}\n"
    with pytest.raises(ConfigurationError, match="Goal has no number 'skiros:PositionsX'; near: skiros:PositionX"):
        check_scenario(parse_scenario(text, PUSH.parent))
