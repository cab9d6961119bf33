"""The test harness: programs, masters and their processes."""

import pytest
from std_msgs.msg import String

from support.programs import Program, descendants
from support.ros import Ros, RosMaster


def test_program_output_is_captured_and_its_processes_end(ros: Ros) -> None:
    ros.program("rostopic", "pub", "-r", "20", "/words", "std_msgs/String", "x")
    assert ros.messages("/words", String).wait_for(lambda message: message.data == "x")
    ros.stop()
    assert "/words" not in ros.master.topics()


def test_descendants_end_with_a_program_even_if_they_ignore_signals() -> None:
    program = Program(["bash", "-c", "trap '' INT; (trap '' INT; sleep 100) & echo started; wait"])
    program.wait_for_line("started")
    family = descendants(program.pid)
    assert [process.running for process in family] == [True]
    program.stop(timeout=0.1)
    assert not program.running
    assert [process.running for process in family] == [False]


def test_waiting_for_a_line_fails_with_the_output_when_the_program_ends() -> None:
    program = Program(["bash", "-c", "echo something else"])
    with pytest.raises(AssertionError, match="something else"):
        program.wait_for_line("something wanted")


def test_private_master_ends_with_all_its_processes(ros_master: RosMaster, tmp_path) -> None:
    with RosMaster(tmp_path) as master:
        assert master.port != ros_master.port
        family = descendants(master._roscore.pid)
        assert "/rosout" in master.nodes()
    assert family
    assert not any(process.running for process in family)
