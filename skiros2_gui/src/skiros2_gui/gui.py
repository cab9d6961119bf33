"""The window as an rqt plugin: `rqt_gui -s gui.skiros`.

rqt, which has started its node, makes one `Skiros` for each instance and calls its methods in the Qt thread.
"""

from __future__ import annotations

import json
from typing import Any

try:
    from rqt_gui_py.plugin import Plugin
except ImportError as error:
    raise ImportError(
        f"skiros2_gui.gui is a plugin of rqt, and rqt_gui_py cannot be imported here ({error}); "
        "the same window without rqt: rosrun skiros2_gui skiros_gui",
        name=error.name,
    ) from error

from skiros2_common.ros.plugins import load_plugins
from skiros2_gui.app.ros.system import RosSystem
from skiros2_gui.app.widgets.main_widget import MainWidget

#: The key of the instance settings, whose value is a JSON text: rqt's files keep texts only.
_KEY = "window"


class Skiros(Plugin):  # type: ignore[misc]
    """One instance of the window in rqt.

    :param context: rqt's `PluginContext`.
    """

    def __init__(self, context: Any) -> None:
        super().__init__(context)
        self.setObjectName("Skiros")
        load_plugins("skiros2_gui")
        self._window = MainWidget(RosSystem)
        title = self._window.windowTitle()
        if context.serial_number() > 1:
            title += f" ({context.serial_number()})"
        self._window.setWindowTitle(title)
        context.add_widget(self._window)

    def shutdown_plugin(self) -> None:
        """Called once, when the instance or rqt is closed."""
        self._window.shut_down()

    def save_settings(self, plugin_settings: Any, instance_settings: Any) -> None:
        """Called before the end, and when the perspective is saved."""
        instance_settings.set_value(_KEY, json.dumps(self._window.settings()))

    def restore_settings(self, plugin_settings: Any, instance_settings: Any) -> None:
        """Called after the start, and when the perspective changes; unreadable settings are skipped."""
        text = instance_settings.value(_KEY)
        if text is None:
            return
        try:
            settings = json.loads(text)
            if not isinstance(settings, dict):
                raise ValueError(f"expected a JSON object, got {text!r}")
        except (TypeError, ValueError) as error:
            self._window.shared.problems.report("restoring the settings that rqt keeps", error)
            return
        self._window.restore(settings)
