"""A stand-in for rqt, which Debian does not have: finds and loads plugins as rqt_gui does, and keeps their settings.

What it does, in rqt's own steps: the export `<rqt_gui plugin="..."/>` of each package's manifest leads to a plugin.xml,
its `class` elements to Python classes; a plugin is found by any part of its id (`-s gui.skiros`), imported by its
module's name, made with a context, given the settings of its instance back, and asked to save them and to shut down
when it is closed. Where rqt is installed, the plugin's base class is rqt's own.
"""

from __future__ import annotations

import importlib
import sys
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType
from typing import Any
from xml.etree import ElementTree

import pytest
from python_qt_binding.QtCore import QObject, QSettings
from python_qt_binding.QtWidgets import QMainWindow, QWidget


class Plugin(QObject):
    """`rqt_gui_py.plugin.Plugin`."""

    def __init__(self, context: PluginContext) -> None:
        super().__init__(context)
        self.setObjectName("Plugin")

    def shutdown_plugin(self) -> None:
        pass

    def save_settings(self, plugin_settings: Settings, instance_settings: Settings) -> None:
        pass

    def restore_settings(self, plugin_settings: Settings, instance_settings: Settings) -> None:
        pass


def provide_rqt(monkeypatch: pytest.MonkeyPatch) -> None:
    """Makes `rqt_gui_py.plugin` importable where rqt is not installed."""
    if find_spec("rqt_gui_py") is not None:
        return
    package, module = ModuleType("rqt_gui_py"), ModuleType("rqt_gui_py.plugin")
    module.Plugin = Plugin  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "rqt_gui_py", package)
    monkeypatch.setitem(sys.modules, "rqt_gui_py.plugin", module)


class Settings:
    """A group of rqt's settings, stored in a file."""

    def __init__(self, file: Path, group: str) -> None:
        self._file, self._group = file, group

    def value(self, key: str, default_value: Any = None) -> Any:
        return self._open().value(f"{self._group}/{key}", default_value)

    def set_value(self, key: str, value: Any) -> None:
        settings = self._open()
        settings.setValue(f"{self._group}/{key}", value)
        settings.sync()

    def contains(self, key: str) -> bool:
        return bool(self._open().contains(f"{self._group}/{key}"))

    def _open(self) -> QSettings:
        return QSettings(str(self._file), QSettings.IniFormat)


class PluginContext(QObject):
    """What a plugin gets from rqt."""

    def __init__(self, serial_number: int) -> None:
        super().__init__()
        self._serial_number = serial_number
        self.main_window = QMainWindow()
        self.widgets: list[QWidget] = []

    def serial_number(self) -> int:
        return self._serial_number

    def argv(self) -> list[str]:
        return []

    def add_widget(self, widget: QWidget) -> None:
        if not widget.objectName():
            raise AssertionError("rqt wants a name on the widget, to keep where it is")
        if widget in self.widgets:
            raise AssertionError("rqt takes a widget only once")
        self.widgets.append(widget)
        self.main_window.setCentralWidget(widget)
        self.main_window.setWindowTitle(widget.windowTitle())
        self.main_window.show()


class Instance:
    """A plugin that runs."""

    def __init__(self, plugin: Any, context: PluginContext, settings: tuple[Settings, Settings]) -> None:
        self.plugin, self.context, self._settings = plugin, context, settings
        self._is_closed = False

    @property
    def widget(self) -> QWidget:
        (widget,) = self.context.widgets
        return widget

    def close(self) -> None:
        """Nothing, when it is closed already."""
        if self._is_closed:
            return
        self._is_closed = True
        self.plugin.save_settings(*self._settings)
        self.plugin.shutdown_plugin()
        self.context.main_window.close()
        self.context.main_window.deleteLater()


class RqtHost:
    """rqt's plugin manager.

    :param manifest: the package.xml of the package whose plugins it loads.
    :param settings: the file it keeps settings in; another host with the same file is rqt started again.
    """

    def __init__(self, manifest: Path, settings: Path) -> None:
        self._settings = settings
        package = ElementTree.parse(manifest).getroot()
        name = package.findtext("name")
        exports = [export.attrib["plugin"] for export in package.iterfind("export/rqt_gui")]
        #: Of each plugin the attributes of its `class` element, by its id.
        self.plugins: dict[str, dict[str, str]] = {}
        for export in exports:
            library = ElementTree.parse(export.replace("${prefix}", str(manifest.parent))).getroot()
            for description in library.iterfind("class"):
                self.plugins[f"{name}/{description.attrib['name']}"] = dict(description.attrib)

    def find(self, name: str) -> str:
        """The id of the one plugin that `rqt_gui -s name` means."""
        (found,) = (key for key, plugin in self.plugins.items() if name in f"{key} {plugin['type']}".lower())
        return found

    def load(self, name: str, serial_number: int = 1) -> Instance:
        plugin = self.plugins[self.find(name)]
        assert plugin["base_class_type"] == "rqt_gui_py::Plugin"
        module, _, cls = plugin["type"].rpartition(".")
        context = PluginContext(serial_number)
        made = getattr(importlib.import_module(module), cls)(context)
        settings = self.settings_of(name, serial_number)
        made.restore_settings(*settings)
        return Instance(made, context, settings)

    def settings_of(self, name: str, serial_number: int) -> tuple[Settings, Settings]:
        """Those of a plugin, which all instances share, and those of one instance."""
        group = f"pluginmanager/plugin__{self.find(name).replace('/', '__')}"
        return (
            Settings(self._settings, f"{group}/plugin"),
            Settings(self._settings, f"{group}__{serial_number}/plugin"),
        )
