"""Files of CAD models."""

from __future__ import annotations

from pathlib import Path

import rospkg
import rospy

from skiros2_common.core.errors import WrongValue

_PACKAGE = "package://"
#: The parameter with the folder of scenes and models.
_WORKSPACE = "wm/workspace_dir"


def model_file(name: str) -> Path:
    """Returns the file that `skiros:CadModel` names. May call the master.

    :param name: absolute, relative to the workspace of the world model, or `package://PACKAGE/...`.
    :raises WrongValue: there is no such file; the text has the searched place.
    """
    if name.startswith(_PACKAGE):
        package, _, rest = name.removeprefix(_PACKAGE).partition("/")
        try:
            folder = rospkg.RosPack().get_path(package)
        except rospkg.ResourceNotFound:
            raise WrongValue(f"model {name}: there is no package {package!r}") from None
    else:
        rest, folder = name.removeprefix("file://"), ""
        if not Path(rest).is_absolute():
            try:
                folder = str(rospy.get_param(_WORKSPACE, ""))
            except (OSError, rospy.ROSException):
                folder = ""
            if not folder:
                raise WrongValue(f"model {name}: expected an absolute path, or the parameter {_WORKSPACE}")
    file = Path(folder) / rest
    if "\0" in name or not file.is_file():
        raise WrongValue(f"model {name} does not exist (searched: {file})")
    return file
