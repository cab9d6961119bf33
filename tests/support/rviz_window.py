"""The window by itself with rviz in it: selects an element, saves a screenshot of the window, and ends as a user ends
it.

Arguments: the label of the element, and the file of the picture.
"""

from __future__ import annotations

import sys

from python_qt_binding.QtCore import QSettings
from python_qt_binding.QtWidgets import QApplication

from skiros2_gui.app.ros.system import RosSystem
from skiros2_gui.app.widgets.main_widget import MainWidget
from skiros2_gui.driver import Driver
from skiros2_gui.rviz_screenshot import rviz_screenshot
from skiros2_gui.standalone import StandaloneWindow


def main(label: str, picture: str) -> int:
    application = QApplication(sys.argv[:1])
    window = StandaloneWindow(MainWidget(RosSystem), QSettings("skiros2", "rviz_window"))
    window.resize(1200, 800)
    window.show()
    driver = Driver(window)
    driver.wait_until(lambda: window.content.system.scene is not None, "the scene")
    driver.open_tab("World model")
    driver.choose("sceneTree", label)
    is_saved = rviz_screenshot(driver).save(picture)
    window.close()
    application.processEvents()
    return 0 if is_saved else 1


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
