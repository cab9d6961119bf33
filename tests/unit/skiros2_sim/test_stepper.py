"""The thread that steps a simulated world."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator

import pytest

from skiros2_common.core.errors import Refused, UnknownName, WrongValue
from skiros2_motion.core.geometry import Pose
from skiros2_sim.core.scene_spec import BodySpec, SceneSpec
from skiros2_sim.core.stepper import MAX_TIME, Stepper
from skiros2_sim.core.world import World

CUBE = BodySpec("cube", size=(0.1, 0.1, 0.1), pose=Pose((0.0, 0.0, 1.0), (0.0, 0.0, 0.0, 1.0)), movable=True)

Make = Callable[..., Stepper]


@pytest.fixture
def make() -> Iterator[Make]:
    """Makes and starts steppers of a world with a cube that falls."""
    made: list[tuple[Stepper, World]] = []

    def start(hooks: tuple[Callable[[], None], ...] = (), **options: float) -> Stepper:
        world = World(SceneSpec((CUBE,)))
        stepper = Stepper(world, **options)
        for hook in hooks:
            stepper.add_hook(hook)
        made.append((stepper, world))
        stepper.start()
        return stepper

    yield start
    for stepper, world in made:
        stepper.close()
        world.close()


def reached(stepper: Stepper, count: int) -> threading.Event:
    """Before the start: set when so many steps are done."""
    event = threading.Event()
    stepper.add_hook(lambda: event.set() if stepper.count >= count else None)
    return event


def test_paused_world_makes_requested_steps(make: Make) -> None:
    stepper = make(paused=True)
    stepper.step(7)
    stepper.step(0)
    stepper.step(5)
    assert stepper.count == 12
    assert stepper.call(lambda world: world.steps) == 12


def test_paused_world_shows_that_it_lives() -> None:
    with World(SceneSpec((CUBE,))) as world:
        stepper, shown = Stepper(world, 0.0, paused=True), threading.Semaphore(0)
        stepper.add_idle_hook(shown.release)
        stepper.start()
        try:
            assert shown.acquire(timeout=10.0)
            assert shown.acquire(timeout=10.0), "again"
            assert stepper.count == 0
        finally:
            stepper.close()


@pytest.mark.parametrize("rate", [0.0, 1.0])
def test_world_steps_until_it_is_paused(rate: float) -> None:
    with World(SceneSpec((CUBE,))) as world:
        stepper = Stepper(world, rate)
        event = reached(stepper, 24)
        stepper.start()
        assert event.wait(30)
        stepper.pause(True)
        count = stepper.count
        assert stepper.call(lambda world: world.steps) == count
        stepper.close()


def test_step_requests_are_served_in_order(make: Make) -> None:
    stepper = make(paused=True)
    counts: list[int] = []

    def ask(steps: int) -> None:
        stepper.step(steps)
        counts.append(steps)

    threads = [threading.Thread(target=ask, args=(steps,)) for steps in (10, 20, 30)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(30)
    assert sorted(counts) == [10, 20, 30]
    assert stepper.count == 60


def test_call_returns_result_and_raises_errors(make: Make) -> None:
    stepper = make(paused=True)
    assert stepper.call(lambda world: world.pose_of("cube").position) == (0.0, 0.0, 1.0)
    with pytest.raises(UnknownName, match="nobody"):
        stepper.call(lambda world: world.pose_of("nobody"))


def test_hooks_run_after_each_step_in_the_stepping_thread(make: Make) -> None:
    threads: list[str] = []
    stepper = make((lambda: threads.append(threading.current_thread().name),), paused=True)
    stepper.step(3)
    assert threads == ["stepper"] * 3


@pytest.mark.parametrize("steps", [-1, MAX_TIME * 240 + 1])
def test_step_count_out_of_range_is_rejected(make: Make, steps: int) -> None:
    with pytest.raises(WrongValue, match="expected 0 to 864000"):
        make(paused=True).step(steps)


@pytest.mark.parametrize("rate", [float("nan"), float("inf"), -1.0, 1e9])
def test_rate_out_of_range_is_rejected(make: Make, rate: float) -> None:
    stepper = make(paused=True)
    with pytest.raises(WrongValue, match="expected up to 1000 times real time"):
        stepper.set_rate(rate)


def test_running_world_rejects_step_requests(make: Make) -> None:
    with pytest.raises(Refused, match="not paused"):
        make().step(1)


class _Bomb:
    """A motion that fails."""

    outcome = None

    def update(self, dt: float) -> None:
        raise ZeroDivisionError("in the middle of a step")


def test_failed_step_stops_the_world_until_reset() -> None:
    with World(SceneSpec((CUBE,))) as world:
        stepper = Stepper(world, paused=True)
        told: list[str] = []
        stepper.add_hook(lambda: None, told.append)
        stepper.start()
        stepper.call(lambda world: world.motions.add(_Bomb()))
        with pytest.raises(Refused, match="ZeroDivisionError: in the middle of a step"):
            stepper.step(10)
        assert told == [stepper.failure]
        with pytest.raises(Refused, match="reset it"):
            stepper.call(lambda world: world.steps)
        with pytest.raises(Refused, match="reset it"):
            stepper.step(1)

        def reset(world: World) -> None:
            world.reset()
            stepper.recover()

        stepper.call(reset, even_failed=True)
        stepper.step(10)
        assert (stepper.count, stepper.failure) == (11, "")
        stepper.close()


def test_step_request_fails_when_the_world_resumes_or_ends(make: Make) -> None:
    for end, reason in ((lambda s: s.pause(False), "resumed"), (lambda s: s.close(), "ended")):
        inside = threading.Event()
        stepper = make((inside.set,), paused=True)
        refusals: list[str] = []

        def wait(stepper: Stepper = stepper, refusals: list[str] = refusals) -> None:
            try:
                stepper.step(MAX_TIME * 240)
            except Refused as error:
                refusals.append(str(error))

        thread = threading.Thread(target=wait)
        thread.start()
        assert inside.wait(30)
        end(stepper)
        thread.join(30)
        assert len(refusals) == 1
        assert reason in refusals[0]


def test_ended_world_rejects_calls(make: Make) -> None:
    stepper = make()
    stepper.close()
    with pytest.raises(Refused, match="ended"):
        stepper.call(lambda world: world.steps)


def test_slow_world_warns_once_and_does_not_catch_up(
    caplog: pytest.LogCaptureFixture,
) -> None:
    with World(SceneSpec((CUBE,))) as world:
        stepper = Stepper(world, 1000.0)
        event = reached(stepper, 24_000)
        stepper.start()
        assert event.wait(60)
        stepper.close()
    assert [record.getMessage().partition(" (")[0] for record in caplog.records] == [
        "the simulated world cannot keep up with 1000 x real time"
    ]
