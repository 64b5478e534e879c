"""Whether a directory holds runs of one robot or of a team: a description of a team begins with `format`."""

import tomllib
from pathlib import Path

from cooploc.scenarios.recordings.logs.scenario import Log
from cooploc.scenarios.recordings.team.scenario import TeamScenario
from cooploc.scenarios.recordings.team.schema import NAME, text_of


def model(data: Path) -> type[Log] | type[TeamScenario]:
    """The model of the recordings in a directory, by its log.toml.

    Raises:
        BadInput: there is none.

    """
    try:
        content = tomllib.loads(text_of(data / NAME))
    except (tomllib.TOMLDecodeError, RecursionError):
        return TeamScenario  # which says what is wrong
    one_robot = "format" not in content and "time" in content and "robots" not in content
    return Log if one_robot else TeamScenario
