"""The checker of the tutorials finds what differs."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from support.ros import ROOT
from support.tutorial import Reader, Wrong, difference, words

#: The most words that a newcomer reads before the first skill of their own runs.
MOST_WORDS = 1200


@pytest.fixture
def follow(tmp_path: Path):
    def follow(text: str) -> Path:
        page = tmp_path / "page.md"
        page.write_text(text)
        folder = tmp_path / "home"
        folder.mkdir()
        with Reader(folder, dict(os.environ)) as reader:
            reader.follow(page)
        return folder

    return follow


@pytest.mark.parametrize(
    ("shown", "printed"),
    [
        (["task 0 has succeeded after 1.0 s"], "task 12 has succeeded after 3.25 s"),
        (["a  b"], "a b\n\n"),
        (["a ... d"], "a b c d"),
        (["...", "end"], "1\n2\nend"),
        (["start", "..."], "start\n1\n2"),
        ([], ""),
    ],
)
def test_output_as_shown(shown: list[str], printed: str) -> None:
    assert difference(shown, printed) == ""


@pytest.mark.parametrize(
    ("shown", "printed"),
    [
        (["0.25"], "0.26"),
        (["a", "b"], "a"),
        (["a"], "a\nb"),
        (["b"], "a\nb"),
        ([], "a"),
        (["...", "end"], "1\nend\n2"),
    ],
)
def test_output_that_differs(shown: list[str], printed: str) -> None:
    assert difference(shown, printed)


def test_commands_share_folder_and_variables_and_read_the_files_of_the_page(follow) -> None:
    folder = follow(
        '```text title="a/file.txt"\nhello\n```\n```text title="a/file.txt (added)"\nworld\n```\n'
        "```console\n$ cd a\n$ export WORD=file\n$ cat $WORD.txt\nhello\nworld\n$ false # status 1\n```\n"
    )
    assert (folder / "a/file.txt").read_text() == "hello\nworld\n"


@pytest.mark.parametrize(
    "block", ["$ echo one\ntwo", "$ false", "$ true # status 1", "no command", "$ echo \\\n    one\ntwo"]
)
def test_page_that_shows_something_else_is_refused_with_its_line(follow, block: str) -> None:
    with pytest.raises(Wrong, match=r"page\.md, line 3: "):
        follow(f"# Page\n\n```console\n{block}\n```\n")


def test_another_terminal_keeps_running_while_the_next_commands_are_typed(follow) -> None:
    server = '```console title="terminal 1"\n$ sh -c "touch up; echo ready; sleep 60"\nready\n```\n'
    follow(f"{server}```console\n$ ls\nup\n```\n")


def test_first_skill_of_ones_own_runs_after_few_words() -> None:
    before_the_fold = (ROOT / "README.md").read_text().partition("\n## ")[0]
    tutorials = ROOT / "docs/tutorials"
    counted = [words(tutorials / name) for name in ("01_first_goal.md", "02_first_skill.md")]
    assert len(before_the_fold.split()) + sum(counted) <= MOST_WORDS
