"""What is assumed of the world: motion models, sensor models, angles, the direction of arrival."""

from cooploc.estimators.models.motion import Displacement, Unicycle
from cooploc.estimators.models.sensors import Bearing, LogDistance, Range, Sighting

__all__ = ["Bearing", "Displacement", "LogDistance", "Range", "Sighting", "Unicycle"]
