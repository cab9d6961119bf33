"""A film of a run as an animated GIF: the cell, the running tree and the plan, side by side."""

from __future__ import annotations

import itertools
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import matplotlib
from PIL import Image, ImageDraw, ImageFont, ImageOps

from skiros2_common.command_line.layout import Screen
from skiros2_common.core.errors import SkirosError
from skiros2_demo.run_check import Step, name_of
from skiros2_runs.core.progress import NodeMessage
from skiros2_runs.core.states import FAILURE, IDLE, RUNNING, SUCCESS, style_of
from skiros2_skill.command_line.tree import Line, frame_of, picture

#: Sizes in pixels: the picture of the cell, which is cut at top and bottom, the whole, the margin, and the letters.
_CELL, _SIZE, _MARGIN, _LETTERS = (500, 330), (1000, 470), 14, 13
_LINE = 18
#: Width of the tree in letters, and the number of its lines.
_COLUMNS, _LINES = 58, 18
_BACKGROUND, _TEXT = "#14171c", "#e6e6e6"
#: The colour of each ANSI colour of a tree's line.
_COLOURS = {"32": "#4ac26b", "31": "#ff7b72", "36": "#6cb6ff", "33": "#e3b341", "90": "#7d8590", "35": "#d2a8ff"}
#: The same for a step of the plan, by the role of its state.
_ROLES = {"success": "32", "failure": "31", "running": "36", "paused": "33", "idle": "90", "changed": "35"}
#: The last steps of the plan are shown: number of rows and of columns.
_ROWS, _STEP_COLUMNS = 4, 2
#: Number of values of a step that are shown.
_VALUES = 3
_STATES = {"waiting": IDLE, "running": RUNNING, "succeeded": SUCCESS, "failed": FAILURE}
_STARTED = [*_STATES][1:]
#: Number of colours of the GIF.
_PALETTE = 96
#: The film's speed, times real time; the shortest time of a picture, and that of the last one (ms).
_SPEED, _SHORTEST, _LAST = 3.0, 20, 3000


@dataclass(frozen=True)
class Moment:
    """One picture of the film.

    :param time: on the monotonic clock (s).
    :param tree: of the task that runs, or ran last.
    :param steps: of the plan, with their states.
    :param event: the last disturbance; "" for none.
    :param cell: picture of the cell.
    """

    time: float
    tree: Sequence[Line]
    steps: Sequence[Step]
    event: str
    cell: Image.Image


class Film:
    """Takes pictures of a run in a thread of its own; a context manager. An error of the camera ends the film, and is
    reported.

    :param goal: its text, for people.
    :param camera: takes a picture of the cell; raises `SkirosError`.
    :param period: from one picture to the next (s).
    :param name: returns the name of an element.
    :param say: prints a message.
    """

    def __init__(
        self, goal: str, camera: Callable[[], Image.Image], period: float, name: Callable[[str], str],
        say: Callable[[str], None],
    ) -> None:  # fmt: skip
        self._goal = goal
        self._camera = camera
        self._period = period
        self._name = name
        self._say = say
        self._tree: Sequence[Line] = ()
        self._steps: dict[int, Step] = {}
        self._event = ""
        self._moments: list[Moment] = []
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, name="film")

    def __enter__(self) -> Film:
        self._thread.start()
        return self

    def __exit__(self, *error: object) -> None:
        self._ended.set()
        self._thread.join()

    def tree(self, nodes: Sequence[NodeMessage]) -> None:
        """Sets the tree of the following pictures. Any thread."""
        self._tree = picture(Screen(_COLUMNS), frame_of(nodes), nodes[0].robot, _LINES)

    def steps(self, steps: Sequence[Step]) -> None:
        """Sets the steps of the plan; those of an earlier plan stay if they have started. Any thread."""
        started = {number: step for number, step in self._steps.items() if step.get("state") in _STARTED}
        self._steps = started | {step["number"]: step for step in steps if step.get("state") in _STATES}

    def event(self, text: str) -> None:
        """Sets the text of a disturbance. Any thread."""
        self._event = text

    def save(self, file: Path) -> Path:
        """Writes the film. Call it after the end.

        :raises SkirosError: there is no picture.
        """
        if not self._moments:
            raise SkirosError(f"{file.name}: no picture was taken")
        drawn = [self._drawn(moment) for moment in self._moments]
        colours = _montage(drawn).quantize(_PALETTE, dither=Image.Dither.NONE)
        frames = [frame.quantize(palette=colours, dither=Image.Dither.NONE) for frame in drawn]
        times = [moment.time for moment in self._moments]
        lengths = (later - earlier for earlier, later in itertools.pairwise(times))
        durations = [*(round(max(_SHORTEST, 1000 * length / _SPEED)) for length in lengths), _LAST]
        frames[0].save(file, save_all=True, append_images=frames[1:], duration=durations, loop=0, optimize=True)
        return file

    def _run(self) -> None:
        try:
            while True:
                ended = self._ended.wait(self._period)
                now, steps = time.monotonic(), [step for _, step in sorted(self._steps.items())]
                self._moments.append(Moment(now, self._tree, steps, self._event, self._camera()))
                if ended:
                    return
        except SkirosError as error:
            self._say(f"  the film ends: {error}")

    def _drawn(self, moment: Moment) -> Image.Image:
        image = Image.new("RGB", _SIZE, _BACKGROUND)
        image.paste(ImageOps.fit(moment.cell, _CELL, Image.Resampling.LANCZOS), (_MARGIN, _MARGIN))
        page = _Page(ImageDraw.Draw(image))
        x, y = _CELL[0] + 2 * _MARGIN, _MARGIN
        for line in moment.tree:
            page.write(x, y, line.text, _COLOURS.get(line.colour, _TEXT))
            y += _LINE
        y = _CELL[1] + 2 * _MARGIN
        page.write(_MARGIN, y, f"Goal: {self._goal}" + (f"     ! {moment.event}" if moment.event else ""), _TEXT)
        for at, step in enumerate(moment.steps[-_ROWS * _STEP_COLUMNS :]):
            style = style_of(_STATES.get(step.get("state", ""), IDLE))
            column, row = divmod(at, _ROWS)
            left = _MARGIN + column * _SIZE[0] // _STEP_COLUMNS
            colour = _COLOURS[_ROLES[style.colour_role]]
            page.write(left, y + (row + 1) * _LINE, f"{style.symbol} {self._text(step)}", colour)
        return image

    def _text(self, step: Step) -> str:
        values = [self._name(value) for key, value in step.get("arguments", {}).items() if key != "Robot"]
        return f"{step['number']} {name_of(step):<6} {', '.join(values[:_VALUES])}"


class _Page:
    """Writes text with letters that have the trees' symbols: matplotlib brings them."""

    def __init__(self, draw: ImageDraw.ImageDraw) -> None:
        self._draw = draw
        self._font = ImageFont.truetype(f"{matplotlib.get_data_path()}/fonts/ttf/DejaVuSansMono.ttf", _LETTERS)

    def write(self, x: int, y: int, text: str, colour: str) -> None:
        self._draw.text((x, y), text, fill=colour, font=self._font)


def _montage(images: Sequence[Image.Image]) -> Image.Image:
    """Returns some of the images in one, for a common palette."""
    chosen = images[:: max(1, len(images) // 6)]
    whole = Image.new("RGB", (_SIZE[0], _SIZE[1] * len(chosen)))
    for at, image in enumerate(chosen):
        whole.paste(image, (0, _SIZE[1] * at))
    return whole
