"""All looks at a recording, in an order in which what one finds does not hide what the next would.

Units come first, as they need neither clocks nor frames; then clocks, frames, and what lies between robots.
"""

from collections.abc import Callable
from pathlib import Path

from cooploc.estimators.interface import Array
from cooploc.scenarios.recordings.inspect.clocks import look_at_clocks
from cooploc.scenarios.recordings.inspect.distances import (
    look_at_biases,
    look_at_names,
    look_at_range_units,
    look_at_reading_clocks,
)
from cooploc.scenarios.recordings.inspect.finding import Finding, Looked
from cooploc.scenarios.recordings.inspect.frames import look_at_frames
from cooploc.scenarios.recordings.inspect.quality import (
    look_at_arena,
    look_at_dropped,
    look_at_gaps,
    look_at_jumps,
    look_at_stale,
)
from cooploc.scenarios.recordings.inspect.scales import look_at_scales
from cooploc.scenarios.recordings.inspect.signals import look_at_bearings, look_at_rssi
from cooploc.scenarios.recordings.inspect.units import look_at_headings, look_at_lengths, look_at_turn_rates
from cooploc.scenarios.recordings.team_log import TeamLog

ORDER: tuple[Callable[[TeamLog], Looked], ...] = (
    look_at_dropped,
    look_at_gaps,
    look_at_lengths,
    look_at_headings,
    look_at_turn_rates,
    look_at_clocks,
    look_at_stale,
    look_at_jumps,
    look_at_range_units,
    look_at_frames,
    look_at_scales,
    look_at_names,
    look_at_reading_clocks,
    look_at_biases,
    look_at_bearings,
    look_at_rssi,
)
OF_ALL = ("unit", "degrees", "radians", "clock", "axes", "mirrored")  # settings of log.toml for every robot


def look_at_all(log: TeamLog, arena: Array | None = None) -> Looked:
    """Everything odd about a recording, and the recording with that corrected, which is for the eye alone.

    Args:
        log: as a reader made it, in SI units as described or guessed.
        arena: (2, 2) lower left and upper right corner [m], where it is known.

    """
    found: list[Finding] = []
    for look in ORDER:
        new, log = look(log)
        found += new
    found += look_at_arena(log, arena).findings
    return Looked(tuple(_of_some(f, found, log) for f in found), log)


def _of_some(f: Finding, found: list[Finding], log: TeamLog) -> Finding:
    """A finding whose setting is for all robots, but which holds for some: their files must be corrected instead."""
    alike = {g.robot for g in found if (g.kind, g.change.table) == (f.kind, f.change.table)}
    if not f.robot or len(alike) == len(log.robots) or f.kind not in OF_ALL:
        return f
    setting = f"{f.change.setting}; it is for all robots, so correct {Path(f.source).name} where the others are right"
    return f._replace(change=f.change._replace(setting=setting))


def findings(log: TeamLog, arena: Array | None = None) -> tuple[Finding, ...]:
    """Everything odd about a recording."""
    return look_at_all(log, arena).findings
