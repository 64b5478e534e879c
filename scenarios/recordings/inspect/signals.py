"""Bearings against true directions, and signal strength against the logarithm of the distance."""

import numpy as np
from scipy.stats import theilslopes

from cooploc.estimators.models import wrap
from cooploc.scenarios.recordings.inspect.corrected import scaled, with_readings
from cooploc.scenarios.recordings.inspect.finding import Change, Finding, Looked
from cooploc.scenarios.recordings.inspect.geometry import geometry
from cooploc.scenarios.recordings.inspect.robust import concentration, median
from cooploc.scenarios.recordings.team_log import TeamLog

FOLLOWS = 0.6  # mean resultant length
OFFSET = 0.15  # [rad] of a camera against straight ahead
DECAY = (0.8, 8.0)  # path-loss exponents from free space with reflections to a building
MOST = 700  # samples: pairs of samples grow with the square


def look_at_bearings(log: TeamLog) -> Looked:
    """Bearings in degrees, to the right, or from elsewhere than straight ahead."""
    findings = []
    for channel in ("sighting", "landmark"):
        readings = log.readings.get(channel)
        if readings is None or len(readings.time) < 20:
            continue
        seen = geometry(log, channel, readings)
        bearing, expected = readings.values[:, 1], wrap(seen.direction - seen.heading)
        if np.isfinite(expected).sum() < 20:
            continue
        factor, kind = 1.0, "bearing"
        if np.nanmax(np.abs(bearing)) > 2.1 * np.pi:
            factor, kind = 180 / np.pi, "degrees"
            fact = f"bearings reach {np.nanmax(np.abs(bearing)):.4g} as read: they are in degrees"
            change = Change("sightings", ("bearing",), 'unit = "deg"')
            findings.append(Finding(kind, "", readings.source, fact, "sure", change))
            readings = readings._replace(values=scaled(readings.values, factor, (1,)))
            log, bearing = with_readings(log, channel, readings), readings.values[:, 1]
        (follows, offset), (opposes, _) = concentration(bearing - expected), concentration(bearing + expected)
        wanders = concentration(expected)[0] < 0.95
        if opposes > max(FOLLOWS, follows + 0.1) and wanders:
            fact = f"bearings grow to the right (agreement {opposes:.2f}, {follows:.2f} to the left)"
            change = Change("sightings", ("bearing",), "write -bearing into the files")
            findings.append(Finding("bearing", "", readings.source, fact, "sure", change))
            turned = readings.values * [1.0, -1.0]
            log = with_readings(log, channel, readings._replace(values=turned))
        elif follows > FOLLOWS and abs(offset) > OFFSET:
            fact = f"bearings are {np.degrees(offset):+.0f} deg from the true directions (agreement {follows:.2f})"
            change = Change("sightings", ("bearing",), f"subtract {np.degrees(offset):.0f} deg in the files")
            findings.append(Finding("bearing", "", readings.source, fact, "likely", change))
    return Looked(tuple(findings), log)


def look_at_rssi(log: TeamLog) -> Looked:
    """Signal strength that rises with the distance, or is not in dBm."""
    findings = []
    for channel in ("rssi", "anchor_rssi"):
        readings = log.readings.get(channel)
        if readings is None or len(readings.time) < 50:
            continue
        rssi = readings.values[:, 0]
        distance = geometry(log, channel, readings).distance
        known = np.flatnonzero(np.isfinite(rssi) & np.isfinite(distance))
        every = known[:: max(1, len(known) // MOST)]
        middle = median(rssi)
        change = Change("rssi", ("rssi",), "write dBm, which are below 0, into the files")
        if middle > 0:
            fact = f"signal strengths are above 0 (median {middle:.3g}): dBm without their sign, or a share"
            findings.append(Finding("rssi", "", readings.source, fact, "sure", change))
            continue
        if len(every) < 50 or np.ptp(np.log10(distance[every])) < 0.3:
            continue
        fit = theilslopes(rssi[every], -10 * np.log10(distance[every]))
        if fit.high_slope < 0 or not DECAY[0] < fit.high_slope or fit.low_slope > DECAY[1]:
            fact = (
                f"signal strength falls by {10 * fit.slope:.1f} dB where the distance is ten times as long "
                f"(eta {fit.slope:.2f}, 95 % from {fit.low_slope:.2f} to {fit.high_slope:.2f}); 1.5 to 6 is usual"
            )
            findings.append(Finding("rssi", "", readings.source, fact, "likely", change))
    return Looked(tuple(findings), log)
