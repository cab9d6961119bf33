"""Runs a tutorial: types its commands, writes its files, and compares the outputs shown with the real ones.

A tutorial is a page of Markdown. Three kinds of fenced blocks are run, in the order of the page:

    ```console                          commands behind `$`, each with its output
    ```console title="terminal 1"       the same in another terminal; the last command keeps running (a launch file).
                                        The same title with the same commands later finds it running,
                                        unless the block starts with `^C`, which ends it; `^C` alone only ends it.
    ```python title="path/of/file.py"   a file, of any language, written as it stands; ` (added)` behind the path: added
                                        at the end

In an output, `...` stands for any text within a line, and as a line of its own for any lines. Times (`1.2 s`,
`20:17:05`), task numbers (`task 3`) and the amount of white space may differ. `# status 1` behind a command states an
exit status other than 0.

A line of the page says what it needs, see `Needs`:

    > Needs `make demo`, and tutorials [3](03_parameters.md) and [5](05_ontology.md).
"""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

from support.programs import Program

_BLOCK = re.compile(r"^```(\w+)(?: +title=\"([^\"]+)\")?\n(.*?)^```$", re.M | re.S)
_STATUS = re.compile(r"\s+# status (\d+)$")
#: For a command, which may build a workspace (s).
_TIMEOUT = 300.0
_ANY_LINES, _ADDED = "...", " (added)"
_NEEDS = re.compile(r"^> Needs `([^`]+)`, and (.+)\.$", re.M)
_LINK = re.compile(r"\]\((\w+\.md)\)")
#: Lines that only a busy machine prints.
_OF_LOAD = re.compile(r"a tick took .* longer than the period")
#: What may differ from run to run: durations, times of day, and numbers of tasks.
_VARYING = re.compile(r"(?<![\w.])\d+(?:\.\d+)?(?= ?m?s\b)|\b\d\d:\d\d:\d\d\b|(?<=\btask )\d+")


class Block(NamedTuple):
    """A fenced block: its language, its title, its text and the line of the page where it starts."""

    language: str
    title: str
    text: str
    line: int


class Needs(NamedTuple):
    """What a tutorial needs.

    :param setup: a command in the folder of the clone, such as `make demo`.
    :param pages: the tutorials that come before, themselves without those that they need.
    """

    setup: str
    pages: tuple[Path, ...]

    def all_pages(self) -> list[Path]:
        """The tutorials that come before, with all that they need, in an order that fits."""
        found: dict[Path, None] = {}
        for page in self.pages:
            found |= dict.fromkeys([*needs(page).all_pages(), page])
        return list(found)


def needs(page: Path) -> Needs:
    """Returns what a tutorial needs, as it says.

    :raises Wrong: it does not say so.
    """
    found = _NEEDS.findall(page.read_text())
    if len(found) != 1:
        raise Wrong(f"{page.name}: {len(found)} lines like: > Needs `make demo`, and no other tutorial.")
    ((setup, others),) = found
    return Needs(setup, tuple(page.parent / name for name in _LINK.findall(others)))


class Typed(NamedTuple):
    """A command, the output shown under it, and its exit status."""

    command: str
    output: list[str]
    status: int


Runner = Callable[[list[str], Mapping[str, str], Path], "subprocess.CompletedProcess[str]"]


def blocks(page: Path) -> list[Block]:
    """Returns the fenced blocks of a page."""
    text = page.read_text()
    found = _BLOCK.finditer(text)
    return [Block(b[1], b[2] or "", b[3], text.count("\n", 0, b.start()) + 1) for b in found]


def commands(block: Block) -> Iterator[Typed]:
    """The commands of a console block. A command continues behind a backslash."""
    for part in re.split(r"^\$ ", block.text, flags=re.M)[1:]:
        command, *output = re.sub(r"\s*\\\n\s*", " ", part).splitlines()
        status = _STATUS.search(command)
        yield Typed(_STATUS.sub("", command), output, int(status[1]) if status else 0)


def words(page: Path) -> int:
    """Counts the words that a reader reads: all but the outputs of commands."""
    text = page.read_text()
    for block in reversed(list(_BLOCK.finditer(text))):
        if block[1] == "console":
            typed = " ".join(t.command for t in commands(Block("console", "", block[3], 0)))
            text = text[: block.start()] + typed + text[block.end() :]
    return len(re.findall(r"[^\s|#`*-][^\s]*", text))


def difference(expected: list[str], actual: str) -> str:
    """Returns the first expected line that does not match, and the output; "" if all match."""
    lines = [line for line in (_plain(line) for line in actual.splitlines()) if line and not _OF_LOAD.search(line)]
    wanted = [_plain(line) for line in expected]
    wanted = [line for line in wanted if line]
    at, anywhere = 0, False
    for line in wanted:
        if line == _ANY_LINES:
            anywhere = True
            continue
        pattern = re.compile(r" ?.*?".join(map(re.escape, re.split(r" ?\.\.\. ?", line))))
        matching = (i for i in range(at, len(lines)) if pattern.fullmatch(lines[i]))
        found = next(matching, None) if anywhere else at if at < len(lines) and pattern.fullmatch(lines[at]) else None
        if found is None:
            return f"shown:  {line}\nnot in: " + "\n        ".join(lines[at:] or ["(nothing)"])
        at, anywhere = found + 1, False
    rest = lines[at:]
    return "not shown: " + "\n           ".join(rest) if rest and not anywhere else ""


def _plain(line: str) -> str:
    line = re.sub(r"\x1b\[[0-9;]*m", "", line)
    return " ".join(_VARYING.sub("0", line).split())


class Wrong(AssertionError):
    """A tutorial does not show what happens."""


@dataclass
class Reader:
    """Somebody who follows tutorials literally, in one folder. A context manager that ends what was left running.

    :param folder: where terminals open.
    :param env: their environment.
    :param run: runs a command to its end; None: bash does.
    :param replaced: texts that are typed as others, such as a port that is free here.
    """

    folder: Path
    env: dict[str, str]
    run: Runner | None = None
    replaced: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._terminals: dict[str, tuple[str, Program]] = {}
        self._page_env = self.env
        self._cwd, self._shell_env = self.folder, dict(self.env)

    def __enter__(self) -> Reader:
        return self

    def __exit__(self, *error: object) -> None:
        for title in list(self._terminals):
            self.close(title)

    def close(self, title: str) -> None:
        """Ends what runs in a terminal, if anything does."""
        if title in self._terminals:
            self._terminals.pop(title)[1].stop()

    def follow(self, page: Path, env: Mapping[str, str] | None = None) -> None:
        """Runs a tutorial, starting in a new main terminal.

        :param env: further variables of the environment of its terminals.
        :raises Wrong: a command fails, or its output differs; names the page and the line.
        """
        self._page_env = {**self.env, **(env or {})}
        self._cwd, self._shell_env = self.folder, dict(self._page_env)
        for shown in blocks(page):
            block = shown._replace(text=self._typed_text(shown.text))
            try:
                if block.language == "console":
                    self._console(block)
                elif block.title:
                    self._write(block)
            except AssertionError as error:
                shown = [f"\n{name}:\n{program.output_tail(40)}" for name, (_, program) in self._terminals.items()]
                raise Wrong(f"{page.name}, line {block.line}: {error}{''.join(shown)}") from None

    def check_package(self, folder: Path) -> None:
        """Runs the tests of a package of skills in a new terminal, if it is there.

        :raises Wrong: one fails.
        """
        if folder.is_dir():
            script = "source ~/skiros2/install/setup.bash && python3 -m pytest -q -p no:cacheprovider tests"
            done = subprocess.run(
                ["bash", "-c", script], env=self._page_env, cwd=folder, stdin=subprocess.DEVNULL, capture_output=True,
                text=True, check=False,
            )  # fmt: skip
            if done.returncode:
                raise Wrong(f"the tests of {folder.name}:\n{done.stdout}{done.stderr}")

    def _typed_text(self, text: str) -> str:
        for shown, typed in self.replaced.items():
            text = text.replace(shown, typed)
        return text

    def _write(self, block: Block) -> None:
        file = self._cwd / block.title.removesuffix(_ADDED)
        file.parent.mkdir(parents=True, exist_ok=True)
        before = file.read_text() if block.title.endswith(_ADDED) else ""
        file.write_text(before + block.text)

    def _console(self, block: Block) -> None:
        typed = list(commands(block))
        if block.title and block.text == "^C\n":
            self.close(block.title)
            return
        if not typed:
            raise Wrong("no command behind $")
        if block.title:
            self._other_terminal(block.title, typed, block.text.startswith("^C"))
            return
        for each in typed:
            done = self._type(each.command)
            if done.returncode != each.status:
                raise Wrong(f"$ {each.command}\nstatus {done.returncode}\n{done.stdout}{done.stderr}")
            problem = difference(each.output, done.stdout + done.stderr)
            if problem:
                raise Wrong(f"$ {each.command}\n{problem}")

    def _other_terminal(self, title: str, typed: list[Typed], restart: bool) -> None:
        script = "\n".join(each.command for each in typed[:-1])
        last = f"exec {typed[-1].command}"
        if title in self._terminals:
            if not restart and self._terminals[title][0] == script + last and self._terminals[title][1].running:
                return
            self.close(title)
        program = Program(["bash", "-ec", f"{script}\n{last}"], self._page_env, self.folder)
        self._terminals[title] = script + last, program
        for line in typed[-1].output:
            if line.strip() and line.strip() != _ANY_LINES:
                program.wait_for_line(".*".join(map(re.escape, line.strip().split(_ANY_LINES))))

    def _type(self, command: str) -> subprocess.CompletedProcess[str]:
        simple = not re.search(r"[;&|<>$`*?~=]\S*\s|^(cd|source|export|\w+=)", f"{command} ")
        if self.run is not None and simple:
            return self.run(shlex.split(command), self._shell_env, self._cwd)
        state = self.folder / ".terminal"
        script = f"{command}\nstatus=$?\n{{ pwd; env -0; }} >{shlex.quote(str(state))}\nexit $status"
        try:
            done = subprocess.run(
                ["bash", "-c", script], env=self._shell_env, cwd=self._cwd, stdin=subprocess.DEVNULL,
                capture_output=True, text=True, check=False, timeout=_TIMEOUT,
            )  # fmt: skip
        except subprocess.TimeoutExpired:
            raise Wrong(f"$ {command}\nhas not ended in {_TIMEOUT:g} s") from None
        if state.exists():
            folder, _, variables = state.read_text().partition("\n")
            self._cwd = Path(folder)
            self._shell_env = dict(line.split("=", 1) for line in variables.split("\0") if "=" in line)
            state.unlink()
        return done


def main() -> int:
    """Follows the tutorials of the command line in the home folder, as a newcomer does. Returns how many failed."""
    failed = 0
    env = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}  # by which this module is found
    with Reader(Path.home(), env) as reader:
        for name in sys.argv[1:]:
            begin, problem = time.monotonic(), ""
            try:
                reader.follow(Path(name))
            except AssertionError as error:
                problem = f"FAILED: {error}"
            print(f"{name}: {words(Path(name))} words, {time.monotonic() - begin:.0f} s {problem}".rstrip(), flush=True)
            failed += bool(problem)
    return failed


if __name__ == "__main__":
    sys.exit(main())
