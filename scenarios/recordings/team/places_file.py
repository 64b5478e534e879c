"""The places of anchors or landmarks: in the description itself, or in a CSV file beside it."""

from pathlib import Path

import numpy as np

from cooploc.estimators.errors import BadInput
from cooploc.scenarios.recordings.team import schema
from cooploc.scenarios.recordings.team.csv_lines import read_lines
from cooploc.scenarios.recordings.team.team_log import Places


def places(data: Path, declared: schema.Places | None, delimiter: str) -> Places:
    """The fixed things that a table of the description names, those of the file last.

    Raises:
        BadInput: the file is missing or malformed, or names a thing twice.

    """
    found: dict[str, tuple[float, float]] = dict(declared.places) if declared else {}
    if declared and declared.file and declared.name and declared.x and declared.y:
        columns = (declared.x, declared.y)
        path = data / declared.file
        lines = read_lines(path, [c.column for c in columns], [declared.name.column], delimiter)
        for row, (name,) in enumerate(lines.names):
            if name in found or np.isnan(lines.values[row]).any():
                why = "was given before" if name in found else "has no place"
                raise BadInput(f"{lines.at(row)}: {name!r} {why}; correct or remove the line")
            x, y = lines.values[row] * [c.factor for c in columns]
            found[name] = float(x), float(y)
    return Places(tuple(found), np.array(list(found.values()), float).reshape(-1, 2))
