"""The tables of log.toml that follow from what was read: arena, ticks, prior, what models are fitted on."""

import numpy as np

from cooploc.estimators.interface import Array
from cooploc.scenarios.recordings.inspect.toml_text import Entry, Table
from cooploc.scenarios.recordings.team_log import TeamLog

AROUND = 1.0  # [m] of free space around what was seen
TICKS = (0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0)  # [s]
SECONDS = 60.0  # [s] of the first part, at most a third of the recording


def extent(log: TeamLog) -> Array | None:
    """Lower left and upper right corner (2, 2) of all true positions and fixed things, a metre around [m]."""
    places = [s.values[:, :2] for s in log.truth if s is not None] + [log.anchors.positions, log.landmarks.positions]
    every = np.concatenate(places)
    every = every[np.isfinite(every).all(axis=1)]
    if not len(every):
        return None
    low, high = np.floor(every.min(axis=0) - AROUND), np.ceil(every.max(axis=0) + AROUND)
    return np.array([low, high])


def arena_entry(log: TeamLog) -> tuple[Entry, ...]:
    """The line `arena = ...`: of the truth, where there are no fixed things to take it from; and that is said."""
    found = extent(log)
    if found is None or len(log.anchors.names) + len(log.landmarks.names) > 1:
        return ()
    why = "whole metres around the truth, which estimators must not know so well: write the corners of the room"
    return (Entry("arena", [[float(v) for v in corner] for corner in found], why, "perhaps"),)


def settings(log: TeamLog, runs: int) -> tuple[Table, ...]:
    """[sample], [prior] and [fit] for a recording of so many runs."""
    intervals = [float(np.median(np.diff(s.time))) for s in log.odometry if len(s.time) > 1]
    usual = float(np.median(intervals)) if intervals else 0.1
    tick = next((t for t in TICKS if t >= max(usual, 0.1) - 1e-6), TICKS[-1])
    headed = all(s is None or np.isfinite(s.values[:, 2]).any() for s in log.truth)
    sample = Table(
        "sample",
        (
            Entry("tick", tick, f"[s] odometry comes every {usual:.3g} s"),
            Entry("max_gap", round(max(0.5, 5 * usual), 3), "[s] five intervals of odometry, at least 0.5", "likely"),
        ),
    )
    words = "the truth has a heading" if headed else "the truth has no heading: the direction of the first motion"
    prior = Table(
        "prior",
        (
            Entry("position", "first truth", "what the team knows of its start; or the places by name", "perhaps"),
            Entry("position_sd", 0.05, "[m] how well it knows it; usual for a marked start", "perhaps"),
            Entry("heading", "first truth" if headed else "first motion", words, "likely"),
            Entry("heading_sd", 0.05 if headed else 0.2, "[rad]", "perhaps"),
        ),
    )
    return sample, prior, _fit(log, runs)


def _fit(log: TeamLog, runs: int) -> Table:
    if runs > 1:
        return Table("fit", (Entry("on", "other runs", f"there are {runs} runs: none is fitted on itself"),))
    stamps = [s.time for s in log.odometry if len(s.time) > 1]
    span = max(float(t[-1] - t[0]) for t in stamps) if stamps else SECONDS
    seconds = float(f"{min(SECONDS, span / 3):.3g}")
    return Table(
        "fit",
        (
            Entry("on", "first part", "there is one run: models are fitted on its beginning, which is not judged"),
            Entry("seconds", seconds, f"[s] of {span:.4g}: a minute, at most a third", "likely"),
        ),
    )
