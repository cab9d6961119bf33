"""What a re-run of a bag needed, stored beside the bag as `NAME.rerun.json`: event orders and tolerances."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from pathlib import Path

from skiros2_bags.core.bag_file import BagError
from skiros2_bags.testing.field_tolerances import FieldTolerances
from skiros2_runs.core.tolerance import Tolerance


@dataclass(frozen=True)
class Stored:
    """What a re-run without a divergence needed.

    :param orders: the number of event orders that were tried.
    :param tolerances: of measured numbers, and of single fields.
    """

    orders: int
    tolerances: FieldTolerances = field(default_factory=FieldTolerances)

    def write(self, bag: Path) -> Path:
        """Writes the file of a bag and returns its path.

        :raises BagError: the file cannot be written.
        """
        path = _path(bag)
        try:
            measured = self.tolerances.measured
            fields = {name: [each.relative, each.absolute] for name, each in self.tolerances.fields.items()}
            data = {"orders": self.orders, "relative": measured.relative, "absolute": measured.absolute}
            path.write_text(json.dumps({**data, "fields": fields} if fields else data, indent=2) + "\n")
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
        fields = {str(name): Tolerance(*map(float, each)) for name, each in found.get("fields", {}).items()}
        measured = Tolerance(float(found["relative"]), float(found["absolute"]))
        return Stored(int(found["orders"]), FieldTolerances(measured, fields))
    except (OSError, ValueError, LookupError, TypeError) as error:
        raise BagError(f"{path}: expected orders, relative and absolute as JSON: {error!r}") from error


def _path(bag: Path) -> Path:
    return bag.with_suffix(".rerun.json")
