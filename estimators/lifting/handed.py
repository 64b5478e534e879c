"""What a plain object is handed of a tick: its own row, without ranges that tell no direction.

The shipped sensor models refuse a range below `TOO_NEAR_TO_RANGE`. A plain class may have models of its own, so it is
handed none: the range is absent, and the bearing of the same sighting with it.
"""

import numpy as np

from cooploc.estimators.interface import TOO_NEAR_TO_RANGE, Array, Mail, Senses


def senses_of(z: Senses, i: int) -> Senses:
    """What row, or trial, i sensed."""
    arrays = {name: getattr(z, name)[i] for name in Senses._fields[:-1]}
    arrays |= {name: without_short(arrays[name], arrays[name][..., :1]) for name in ("landmark", "sighting")}
    extra = {name: a[i] for name, a in z.extra.items()}
    extra |= {name: without_short(a, a) for name, a in extra.items() if name == "anchor_range"}
    return Senses(**arrays, extra=extra)


def mail_of(mail: Mail, i: int) -> Mail:
    """What row, or trial, i received."""
    mine = Mail(*(a[i] for a in mail))
    return mine._replace(range=without_short(mine.range, mine.range))


def without_short(reading: Array, distance: Array) -> Array:
    """A reading, absent where its distance is too short."""
    short = distance < TOO_NEAR_TO_RANGE
    return np.where(short, np.nan, reading) if short.any() else reading
