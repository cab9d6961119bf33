"""What a re-run of a bag needed, stored beside the bag as `NAME.rerun.json`: event orders and tolerance."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from pathlib import Path

from skiros2_bags.core.bag_file import BagError
from skiros2_runs.core.tolerance import Tolerance


@dataclass(frozen=True)
class Stored:
    """What a re-run without a divergence needed.

    :param orders: the number of event orders that were tried.
    :param relative, absolute: the tolerance of measured numbers.
    """

    orders: int
    relative: float
    absolute: float

    @property
    def tolerance(self) -> Tolerance:
        return Tolerance(self.relative, self.absolute)

    def write(self, bag: Path) -> Path:
        """Writes the file of a bag and returns its path.

        :raises BagError: the file cannot be written.
        """
        path = _path(bag)
        try:
            path.write_text(json.dumps(asdict(self), indent=2) + "\n")
        except OSError as error:
            raise BagError(f"{path} cannot be written: {error}") from error
        return path


def read_stored(bag: Path) -> Stored | None:
    """Returns what is stored for a bag; None without a file.

    :raises BagError: the file cannot be read.
    """
    path = _path(bag)
    if not path.exists():
        return None
    try:
        found = json.loads(path.read_text())
        return Stored(int(found["orders"]), float(found["relative"]), float(found["absolute"]))
    except (OSError, ValueError, LookupError, TypeError) as error:
        raise BagError(f"{path}: expected orders, relative and absolute as JSON: {error!r}") from error


def _path(bag: Path) -> Path:
    return bag.with_suffix(".rerun.json")
