"""Errors of the world model keep their code and position on the way to a client."""

import pytest

rospy = pytest.importorskip("rospy")

from skiros2_common.core.errors import Conflict, SkirosError, UnknownName  # noqa: E402
from skiros2_world_model.core.triple_store import QueryError  # noqa: E402
from skiros2_world_model.core.wm_errors import WmConflict, WmException  # noqa: E402
from skiros2_world_model.ros.service_pool import read_error, service_handler  # noqa: E402


def transmitted(error: SkirosError) -> WmException:
    def fail(_: object) -> None:
        raise error

    with pytest.raises(rospy.ServiceException) as refused:
        service_handler(fail)(None)
    return read_error(str(refused.value))


@pytest.mark.parametrize(
    ("error", "kind", "position"),
    [
        (UnknownName("there is no element 'x' [1]\nin y"), WmException, (0, 0)),
        (Conflict("x was changed by y"), WmConflict, (0, 0)),
        (QueryError("error at 3:7: expected OPTIONAL", "SELECT"), WmException, (3, 7)),
    ],
)
def test_client_gets_text_code_and_position(error, kind, position):
    read = transmitted(error)
    assert type(read) is kind
    assert (str(read), read.code, read.position) == (str(error), error.code, position)


def test_text_without_code_is_kept():
    read = read_error("the node is busy [3 of 4]")
    assert (str(read), read.code) == ("the node is busy [3 of 4]", SkirosError.code)
