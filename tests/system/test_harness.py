"""The harness that the other tests here stand on."""

import pytest
from std_msgs.msg import String

from support.programs import Program, descendants
from support.ros import Ros, RosMaster


def test_a_program_is_heard_and_nothing_of_it_is_left_afterwards(ros: Ros) -> None:
    ros.program("rostopic", "pub", "-r", "20", "/words", "std_msgs/String", "x")
    assert ros.messages("/words", String).wait_for(lambda message: message.data == "x")
    ros.stop()
    assert "/words" not in ros.master.topics()


def test_what_a_program_has_started_ends_with_it_even_when_it_does_not_listen() -> None:
    program = Program(["bash", "-c", "trap '' INT; (trap '' INT; sleep 100) & echo started; wait"])
    program.wait_for_line("started")
    family = descendants(program.pid)
    assert [process.running for process in family] == [True]
    program.stop(timeout=0.1)
    assert not program.running
    assert [process.running for process in family] == [False]


def test_waiting_for_a_line_ends_with_the_program_and_shows_what_it_printed() -> None:
    program = Program(["bash", "-c", "echo something else"])
    with pytest.raises(AssertionError, match="something else"):
        program.wait_for_line("something wanted")


def test_a_master_of_its_own_goes_with_all_its_processes(ros_master: RosMaster, tmp_path) -> None:
    with RosMaster(tmp_path) as master:
        assert master.port != ros_master.port
        family = descendants(master._roscore.pid)
        assert "/rosout" in master.nodes()
    assert family
    assert not any(process.running for process in family)
