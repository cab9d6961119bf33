"""The window as an rqt plugin: `rqt_gui -s gui.skiros`.

rqt (with its node, which it has started) makes one `Skiros` for each instance that is opened, and calls its methods in
the Qt thread. Everything to see is in the one widget that the standalone window shows too.
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

from skiros2_gui.qt.main_widget import MainWidget
from skiros2_gui.ros.system import RosSystem

#: Where the instance's settings keep the window's, as one JSON text: rqt's files keep texts as they are, but turn other
#: values into texts or lists.
_KEY = "window"


class Skiros(Plugin):  # type: ignore[misc]
    """One window inside rqt.

    :param context: rqt's `PluginContext`: takes the widget, and counts the instances from 1.
    """

    def __init__(self, context: Any) -> None:
        super().__init__(context)
        self.setObjectName("Skiros")
        self._window = MainWidget(RosSystem)
        title = self._window.windowTitle()
        if context.serial_number() > 1:
            title += f" ({context.serial_number()})"
        self._window.setWindowTitle(title)
        context.add_widget(self._window)

    def shutdown_plugin(self) -> None:
        """Called once, when the instance or rqt is closed; not when rqt is killed."""
        self._window.shut_down()

    def save_settings(self, plugin_settings: Any, instance_settings: Any) -> None:
        """Called before the end, and when the perspective is saved."""
        instance_settings.set_value(_KEY, json.dumps(self._window.settings()))

    def restore_settings(self, plugin_settings: Any, instance_settings: Any) -> None:
        """Called after the start, and when another perspective is chosen; what cannot be read is left out."""
        text = instance_settings.value(_KEY)
        if text is None:
            return
        try:
            settings = json.loads(text)
            if not isinstance(settings, dict):
                raise ValueError(f"expected a JSON object, there is {text!r}")
        except (TypeError, ValueError) as error:
            self._window.shared.problems.tell("restoring the settings that rqt keeps", error)
            return
        self._window.restore(settings)
