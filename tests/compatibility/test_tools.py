"""The logger, stopwatches and the plugin loader as libraries use them. Compatibility, section 11."""

import subprocess
import sys

import pytest

from compatibility.rules import rule
from skiros2_common.tools import logger as log
from skiros2_common.tools.plugin_loader import PluginLoader
from skiros2_common.tools.time_keeper import TimeKeeper, Timer


@pytest.fixture(autouse=True)
def fresh():
    before = log.getLevel()
    log.reset()
    yield
    log.reset()
    log.setLevel(before)


def lines(capsys):
    return capsys.readouterr().out.splitlines()


@rule("tools", "The logger shows its messages on stdout in every process, without any set-up")
def test_a_plain_script_shows_its_messages():
    script = "from skiros2_common.tools import logger as log\nlog.info('[node]', 'here')\nlog.trace('deep')\n"
    environment = {"PYTHONPATH": ":".join(sys.path), "PATH": ""}
    ran = subprocess.run([sys.executable, "-c", script], env=environment, capture_output=True, text=True, timeout=60)
    assert ran.stderr == ""
    assert [
        line.replace(log.logColor.MAGENTA, "").replace(log.logColor.ENDC, "") for line in ran.stdout.splitlines()
    ] == [
        f"{'[node]':<20} here",
        "deep",
    ]


@rule("tools", "A message is one line, `message` (padded to 20 characters) and `description`, coloured by its level")
def test_a_line(capsys):
    log.error("[pick]", "no arm")
    log.useColor(False)
    log.error("alone")
    coloured, plain = lines(capsys)
    assert coloured == f"{log.logColor.RED}{'[pick]':<20} no arm{log.logColor.ENDC}"
    assert plain == "alone"


@rule("tools", "Levels are ALWAYS -1, ERROR 0, WARN 1, OK 2, INFO 3, DEBUG 4, TRACE 5; all up to the set one are shown")
def test_levels(capsys):
    assert (log.ALWAYS, log.ERROR, log.WARN, log.OK, log.INFO, log.DEBUG, log.TRACE) == (-1, 0, 1, 2, 3, 4, 5)
    assert log.logMode.WARN == log.WARN
    assert log.getLevel() == log.TRACE
    log.useColor(False)
    log.setLevel(log.OK)
    assert log.getLevel() == log.OK
    for name in ("always", "error", "warn", "ok", "info", "debug", "trace"):
        getattr(log, name)(name)
    assert lines(capsys) == ["always", "error", "warn", "ok"]


@rule("tools", "`assertError` and `assertWarn` log when the condition is false, and return the condition")
@pytest.mark.parametrize("name", ["assertError", "assertWarn"])
def test_assert_of_failures(name, capsys):
    assert getattr(log, name)(True, "[pick]", "no arm") is True
    assert lines(capsys) == []
    assert getattr(log, name)(False, "[pick]", "no arm") is False
    assert len(lines(capsys)) == 1


@rule("tools", "`assertOk` and `assertInfo` log when the condition is true, and return `not` the condition")
@pytest.mark.parametrize("name", ["assertOk", "assertInfo"])
def test_assert_of_successes(name, capsys):
    assert getattr(log, name)(False, "[pick]", "an arm") is True
    assert lines(capsys) == []
    assert getattr(log, name)(True, "[pick]", "an arm") is False
    assert len(lines(capsys)) == 1


@rule("tools", "The logger remembers: `last*`, `count*Msg`, `has*`, `test*`, `msg*`, `toString`, `dump`, `clear`")
def test_log_keeps_its_messages(capsys, tmp_path):
    assert not log.hasError() and not log.testWarn() and log.lastError() == ""
    log.error("[a]", "first")
    log.error("[a]", "second")
    log.warn("careful")
    assert "second" in log.lastError() and log.lastWarn() == "careful"
    assert (log.countErrorMsg(), log.countWarnMsg(), log.countInfoMsg()) == (2, 1, 0)
    assert log.hasError() and log.hasWarn() and log.testError() and log.testWarn() and not log.hasDebug()
    assert log.msgWarn() == ["careful"]
    assert log.toString().splitlines()[-1].endswith("careful")
    log.dump(str(tmp_path / "log.txt"))
    assert (tmp_path / "log.txt").read_text() == log.toString() + "\n"
    log.clear()
    assert log.countErrorMsg() == 0 and log.toString() == ""


@rule("tools", "`indent`, `unindent`, `enableOutput`, `disableOutput`, `Log`, `logColor.MAGENTA`")
def test_settings(capsys):
    log.useColor(False)
    log.indent()
    log.info("inner")
    log.unindent()
    log.info("outer")
    log.disableOutput()
    log.info("silent")
    log.enableOutput()
    log.Log("another").info("from a log of its own")
    inner, *others = lines(capsys)
    assert inner != "inner" and inner.strip() == "inner"
    assert others == ["outer", "from a log of its own"]
    assert log.countInfoMsg() == 3
    assert log.logColor.MAGENTA.startswith("\033[")


@rule("tools", "`with TimeKeeper() as t` times the block; `get_avg_time()` is None before the first time")
def test_time_keeper():
    assert TimeKeeper().get_avg_time() is None
    with TimeKeeper() as keeper:
        assert keeper.get_avg_time() is None
    assert keeper.get_avg_time() == keeper.get_last() >= 0.0


@rule("tools", '`with Timer("x") as t: t.toc("...")` logs the time since the start')
def test_timer(caplog):
    caplog.set_level("INFO")
    with Timer("load") as timer:
        assert timer.toc("ontology") >= 0.0
    assert "load" in caplog.text and "ontology" in caplog.text


# -- plugins -------------------------------------------------------------------------------------------------------


class Base:
    pass


@pytest.fixture
def library(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setitem(sys.modules, "base_of_these_plugins", sys.modules[__name__])
    (tmp_path / "compatible_library").mkdir()
    (tmp_path / "compatible_library" / "__init__.py").write_text("")
    text = "from base_of_these_plugins import Base\nclass Arm(Base):\n    pass\nclass Leg(Base):\n    pass\n"
    (tmp_path / "compatible_library" / "limbs.py").write_text(text)
    yield "compatible_library"
    for name in [name for name in sys.modules if name.startswith("compatible_library")]:
        del sys.modules[name]


@rule("tools", "`PluginLoader` is iterable over classes; `load` returns None; `list()` prints and returns the names")
def test_plugin_loader(library, capsys):
    loader = PluginLoader()
    assert loader.load(library, Base) is None
    assert sorted(cls.__name__ for cls in loader) == sorted(loader.list()) == ["Arm", "Leg"]
    assert sorted(capsys.readouterr().out.split()) == ["Arm", "Leg"]
    assert loader.getPluginByName("Arm") in list(loader)


@rule("tools", "`getPluginByName` raises when the name is unknown", better="the error names the nearest plugins")
def test_an_unknown_plugin(library):
    loader = PluginLoader()
    loader.load(library, Base)
    with pytest.raises(KeyError, match="Arm"):
        loader.getPluginByName("Am")


@rule("tools", "Loading a package that does not exist is an `ImportError`")
def test_a_missing_package():
    with pytest.raises(ImportError, match="no_such_library"):
        PluginLoader().load("no_such_library", Base)
