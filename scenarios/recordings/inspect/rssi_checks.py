"""Checks of signal strength against the truth: it falls with the logarithm of distance, alike for all radios."""

import numpy as np
import pandas as pd

from cooploc.estimators.interface import Array
from cooploc.scenarios.recordings.inspect import motion
from cooploc.scenarios.recordings.inspect.findings import EVIDENCE, LEAST_DELAY, LONGEST_DELAY, CheckedLog
from cooploc.scenarios.recordings.team_log import Channel, ReadingSeries, TeamLog, other_names

CHANNELS: tuple[Channel, ...] = ("rssi", "anchor_rssi")
RANGES: dict[Channel, Channel] = {"rssi": "range", "anchor_rssi": "anchor_range"}
SHARE, ABOVE = 0.03, 3.0  # of readings, and times those of the next value, that equal the lowest: a floor
USUAL = (10.0, 80.0)  # [dB] by which signals fall in ten times the distance: exponents of 1 to 8
DEVICE = 3.0  # [dB] by which radios differ from each other
SHARPER = 0.97  # times the spread, from which a shift of stamps is believed: noise is large, and distances are smooth
VARIED = 0.02  # of log10 of distances, from which signals can fall with them
LEVELS = 20  # of signals at least, of which ranges may be a function
INDEPENDENT = 5  # readings of a radio, as one says much of the next


def check_rssi(c: CheckedLog) -> None:
    """Find signal strengths with a floor, of another fall than with distance, of unlike radios, late, or as ranges."""
    for channel in CHANNELS:
        readings, ranges = c.log.readings.get(channel), c.log.readings.get(RANGES[channel])
        if readings is None or len(readings.time) < motion.FEWEST:
            continue
        if ranges is not None and _is_function(ranges, readings):
            fact = (
                "ranges follow from the signals, without any noise of their own: they were computed from them, perhaps"
            )
            setting = "remove this table: filters would count one measurement twice"
            c.add("signals", None, ranges.source, fact, "likely", setting, motion.TABLES[RANGES[channel]])
        values, counts = np.unique(readings.values[:, 0], return_counts=True)
        if len(values) > 2 and counts[0] > max(SHARE * counts.sum(), ABOVE * counts[1:3].max()):
            fact = (
                f"{counts[0] / counts.sum():.0%} of the signals are {values[0]:g} dBm, the lowest: it stands for less"
            )
            setting = f"missing_below = {(values[0] + values[1]) / 2:g}"
            c.add("floor", None, readings.source, fact, "likely", setting, "rssi")
            kept = readings.values[:, 0] > values[0]
            time, robot, other, measured, source = readings
            readings = ReadingSeries(time[kept], robot[kept], other[kept], measured[kept], source)
            c.correct(channel, None, readings)
        distance = motion.distances(c.log, channel)
        residual, slope, error = _fit(distance, readings.values[:, 0])
        if not np.isfinite(slope):
            continue
        if not USUAL[0] < -slope < USUAL[1] and error < USUAL[0]:
            fact = (
                f"signals change by {slope:+.3g} dB in ten times the distance, where {-USUAL[0]:g} to {-USUAL[1]:g} are"
            )
            setting = "nothing: write dBm, and look whether names are exchanged"
            c.add("signals", None, readings.source, f"{fact} usual", "likely", setting, "rssi")
            continue
        shift, spread = _best_shift(c.log, channel, readings)
        now = float(np.nanstd(residual))
        evidence = len(residual) / INDEPENDENT * np.log(now / spread) if spread > 0 else 0.0
        if abs(shift) >= LEAST_DELAY and spread < SHARPER * now and evidence > EVIDENCE**2 / 2:
            fact = (
                f"stamps of signals are {-shift:+.2g} s from the truth's: they spread by {now:.2f} dB about a line over"
            )
            fact += f" the logarithm of distance, and by {spread:.2f} dB without that"
            c.add("clock", None, readings.source, fact, "likely", f"clock_offset = {shift:.2g}", "rssi")
        for names, owner, word in (
            (c.log.robots, readings.robot, "received by"),
            (other_names(c.log, channel), readings.other, "sent by"),
        ):
            of_each = [residual[owner == k] for k in range(len(names))]
            off = np.array([motion.quantile(own, 0.5, motion.FEWEST) for own in of_each])
            if np.isfinite(off).sum() > 1 and np.nanmax(np.abs(off)) > DEVICE:
                each = ", ".join(f"{name} {off[k]:+.0f} dB" for k, name in enumerate(names) if np.isfinite(off[k]))
                fact = f"signals {word} {each}: medians about one line over the logarithm of distance"
                setting = "nothing: subtract that in the files, if radios or their antennas differ"
                c.add("signals", None, readings.source, fact, "likely", setting)
                residual = residual - off[owner]


def _is_function(ranges: ReadingSeries, signals: ReadingSeries) -> bool:
    """Return whether each range of the same lines is longer where the signal is weaker, but for rounding."""
    one, other = (
        pd.DataFrame({"time": r.time, "robot": r.robot, "other": r.other, name: r.values[:, 0]})
        for r, name in ((ranges, "range"), (signals, "signal"))
    )
    both = one.merge(other).sort_values(["signal", "range"], ascending=[True, False])
    return both["signal"].nunique() > LEVELS and bool((both["range"].diff().dropna() <= 0).mean() > 0.999)


def _fit(distance: Array, values: Array) -> tuple[Array, float, float]:
    """Fit a line over log10 of distance (m,): residuals [dB], nan where unknown, slope [dB] and its standard error."""
    known, x = np.isfinite(distance), np.log10(distance)
    if known.sum() < motion.FEWEST or np.std(x[known]) < VARIED:
        return np.full(len(values), np.nan), np.nan, np.inf
    slope, level = np.polynomial.polynomial.polyfit(x[known], values[known], 1)[::-1]
    residual = values - level - slope * x
    error = np.nanstd(residual) / (np.std(x[known]) * np.sqrt(known.sum() / INDEPENDENT))
    return residual, float(slope), float(error)


def _best_shift(log: TeamLog, channel: Channel, readings: ReadingSeries) -> tuple[float, float]:
    """Return the shift [s] of stamps at which signals spread least about a line, and their spread [dB]."""

    def spread(shift: float) -> float:
        later = {**log.readings, channel: readings._replace(time=readings.time + shift)}
        distance = motion.distances(log._replace(readings=later), channel)
        residual, slope, _ = _fit(distance, readings.values[:, 0])
        return float(np.nanstd(residual)) if np.isfinite(slope) else np.inf

    shifts = np.linspace(-LONGEST_DELAY, LONGEST_DELAY, 41)
    spreads = [spread(shift) for shift in shifts]
    best = int(np.argmin(spreads))
    return float(shifts[best]), spreads[best]
