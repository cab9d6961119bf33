"""What holds for all tests.

- Every test has the marker of the folder it lies in: `pytest -m "unit or contract"` needs no mark in the files.
- Tests in other folders that are marked `long` are run by `make test-long`, with `-m`, and by their own names.
- A run that is told to end (SIGTERM) ends like one that is interrupted: with all that it has started.
- Tests of skills have the fixtures of `skiros2_skill.testing`, and those of recorded runs the fixture `replayed`.
- Generated tests have no time limit for an example, and use the same examples each time, unless FUZZ is set, which also
  makes them more (support/fuzz.py).
- Tests on real nodes have the fixtures `ros_master` and `ros`; what these give is described in tests/support/ros.py.
"""

from __future__ import annotations

import gc
import os
import resource
import signal
import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import hypothesis
import pytest

from support.packages import source_folders

sys.path[:0] = [str(folder) for folder in source_folders()]

from support.fuzz import FUZZ, examples  # noqa: E402
from support.ros import Ros, RosMaster, SharedSystem, forks_cpu  # noqa: E402

pytest_plugins = ["skiros2_skill.testing", "skiros2_bags.testing"]

TESTS = Path(__file__).parent
LONG = TESTS / "long"

#: The slowest tests are listed after a run of at least this many tests.
_MANY_TESTS, _SLOWEST = 1000, 20

hypothesis.settings.register_profile("repeatable", deadline=None, derandomize=not FUZZ, max_examples=examples(100))
hypothesis.settings.load_profile("repeatable")

_ROS = pytest.StashKey[Ros]()
_SPENT = pytest.StashKey[float]()

#: The tests that failed in a run of several processes, each with the reason, written as they end.
FAILURES = TESTS.parent / "build" / "failures.txt"

#: The tests that failed in a whole run and passed alone, a line for each time: date and test. `.ci/run` adds to it.
SECOND_TRIES = TESTS / "second_tries.txt"

_CPU = "cpu"  # the property of a test's last report with the seconds of CPU since the test before


def pytest_configure(config: pytest.Config) -> None:
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, signal.default_int_handler)
    _, most = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (most, most))  # the tests of a process open several hundred connections
    if signal.getsignal(signal.SIGHUP) == signal.SIG_IGN:  # nohup: this process goes on, what it starts hears of it
        signal.signal(signal.SIGHUP, lambda *_: None)


def pytest_xdist_setupnodes() -> None:
    FAILURES.parent.mkdir(exist_ok=True)
    FAILURES.write_text("")


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    if report.failed and hasattr(report, "node"):  # in the process that collects the reports
        with FAILURES.open("a") as failures:
            print(f"FAILED {report.nodeid}\n{report.longreprtext}", *map("\n".join, report.sections), file=failures)


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    for item in items:
        if TESTS in item.path.parents:  # it is no bag that was named on the command line
            item.add_marker(item.path.relative_to(TESTS).parts[0])
    if not config.option.markexpr and not any("::" in name for name in config.args):
        later = [item for item in items if item.get_closest_marker("long") and LONG not in item.path.parents]
        config.hook.pytest_deselected(items=later)
        items[:] = [item for item in items if item not in later]


def pytest_collection_finish() -> None:
    """Takes what is there for good out of garbage collections: all tests, and the modules that they import."""
    gc.collect()
    gc.freeze()
    gc.set_threshold(10_000, 20, 20)


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Keeps the times of all tests, set-up and teardown included, in build/test_times.txt, the slowest first. Prints
    the slowest, the CPU of each folder, and the tests that have needed a second try."""
    times: dict[str, float] = {}
    cpu: Counter[str] = Counter()
    for reports in terminalreporter.stats.values():
        for report in reports:
            if isinstance(report, pytest.TestReport):
                times[report.nodeid] = times.get(report.nodeid, 0.0) + report.duration
                cpu[_folder(report.nodeid)] += dict(report.user_properties).get(_CPU, 0.0)
    if len(times) < _MANY_TESTS:
        return
    terminalreporter.section(f"CPU: {cpu.total() / 60:.1f} min")
    terminalreporter.write_line("\n".join(f"{seconds:8.0f} s  {folder}" for folder, seconds in cpu.most_common()))
    tries = Counter(line.split(maxsplit=1)[1] for line in SECOND_TRIES.read_text().splitlines())
    terminalreporter.section(f"tests that have needed a second try, and how often ({SECOND_TRIES.name})")
    terminalreporter.write_line("\n".join(f"{count:4}  {name}" for name, count in tries.most_common()) or "none")
    slowest = sorted(times.items(), key=lambda item: -item[1])
    lines = [f"{seconds:8.2f} s  {name}" for name, seconds in slowest]
    target = TESTS.parent / "build" / "test_times.txt"
    target.parent.mkdir(exist_ok=True)
    target.write_text("\n".join(lines) + "\n")
    terminalreporter.section(f"slowest tests (all: {target.relative_to(TESTS.parent)})")
    terminalreporter.write_line("\n".join(lines[:_SLOWEST]))


def _folder(test: str) -> str:
    """The folder of the test, without `tests`: `unit/skiros2_task`."""
    return str(Path(test.partition("::")[0]).parent).removeprefix("tests/")


def _cpu_seconds() -> float:
    """The CPU time of this process, and of programs that have ended (s)."""
    spent = os.times()
    return spent.user + spent.system + spent.children_user + spent.children_system + forks_cpu()


@pytest.fixture(scope="session")
def ros_master(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RosMaster]:
    """A master for the session, and in this process a node `/tests_...` on it."""
    master = RosMaster(tmp_path_factory.mktemp("ros_home"))
    before = dict(os.environ)
    os.environ.update({key: master.env[key] for key in ("ROS_MASTER_URI", "ROS_HOSTNAME", "ROS_HOME")})
    with master:
        import rospy

        from skiros2_common.ros.node import handshake_in_threads

        rospy.init_node("tests", anonymous=True, disable_signals=True)
        handshake_in_threads()
        yield master
        rospy.signal_shutdown("the tests are over")
    os.environ.clear()
    os.environ.update(before)


@pytest.fixture
def ros(ros_master: RosMaster, request: pytest.FixtureRequest) -> Iterator[Ros]:
    """Starts nodes and launch files on the session's master; they end with the test."""
    programs = Ros(ros_master)
    request.node.stash[_ROS] = programs
    yield programs
    programs.stop()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_teardown(item: pytest.Item, nextitem: pytest.Item | None) -> Iterator[None]:
    """Takes what a file's tests leave in caches out of garbage collections, which were a quarter of the CPU. Sockets of
    closed topics, which rospy leaves to a collection, are closed here."""
    yield
    if nextitem is None or nextitem.path != item.path:
        gc.collect()
        gc.freeze()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item) -> Iterator[None]:
    report = yield
    spent = _cpu_seconds()
    before = item.config.stash.setdefault(_SPENT, spent)
    if report.when == "teardown":  # the only report whose properties are in the file of --junitxml
        report.user_properties = [(_CPU, spent - before)]
        item.config.stash[_SPENT] = spent
    if report.failed:
        systems = [value for value in getattr(item, "funcargs", {}).values() if isinstance(value, SharedSystem)]
        systems += [ros] if (ros := item.stash.get(_ROS, None)) else []
        programs = [program for system in systems for program in system.programs]
        report.sections += [(f"{program}", program.output_tail(400)) for program in programs]
    return report
