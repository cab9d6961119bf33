"""Errors keep their class and data when their text changes."""

from skiros2_common.core.errors import UnknownName, WrongValue


class Misplaced(WrongValue):
    """An error whose constructor takes other arguments than a text."""

    def __init__(self, line: int, column: int) -> None:
        super().__init__(f"line {line}, column {column}")
        self.position = (line, column)


def test_error_with_another_text_keeps_class_and_data():
    error = Misplaced(3, 7).with_text("goal.txt: line 3, column 7")
    assert isinstance(error, Misplaced)
    assert (str(error), error.position, error.code) == ("goal.txt: line 3, column 7", (3, 7), "wrong_value")


def test_text_of_a_key_error_is_not_quoted():
    assert str(UnknownName("no key 'A'").with_text("Pick: no key 'A'")) == "Pick: no key 'A'"
