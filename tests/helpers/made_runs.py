"""Runs that were never run, and the outline of a page: what tests of reports, tables and comparisons share."""

from html.parser import HTMLParser

import numpy as np
import pandas as pd
from made_errors import rows

from cooploc.analysis.execution.run_directory import StoredRun

EVIL = "<script>alert('x')</script>&\"$_%"
VOID = {"meta", "br", "link", "input"}


class Outline(HTMLParser):
    """Tags with their attributes, and whether they nest."""

    def __init__(self, text):
        super().__init__()
        self.tags, self.open = [], []
        self.feed(text)
        self.close()

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))
        self.open += [] if tag in VOID else [tag]

    def handle_startendtag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def rows(self, mark):
        return [attributes for tag, attributes in self.tags if tag == "tr" and mark in attributes]


def rows_of(scenario, estimators, trials=8, failed=(), bounds=()):
    """Rows of a run without running: per estimator RMSE [m] and ANEES, with the same noise for everyone."""
    noise, frames = np.random.default_rng(7).uniform(0.8, 1.2, (trials, len(estimators))), []
    for i, (name, (rmse, anees)) in enumerate(estimators.items()):
        mse = rmse**2 * noise[:, i]
        names = ("rmse", "mean_error", "median_error", "max_error", "final_error")
        frame = rows(name, mse[:, None], anees=anees * noise[::-1, i], scenario=scenario, stream=scenario).assign(
            **dict.fromkeys(names, np.sqrt(mse)), bytes=48.0 + i, seconds=1e-4 * (1 + i), failure=None, traceback=None
        )
        frame["centralised"] = frame["bound"] = name in bounds
        if name in failed:
            frame.loc[0, ["failure", "traceback"]] = f"RuntimeError: {EVIL}"
        frames.append(frame)
    return pd.concat(frames, ignore_index=True)


def kept_from(rows, folder, experiment="one", **study):
    cells = {}
    for scenario, part in rows.groupby("scenario", sort=False):
        names = list(dict.fromkeys(part["estimator"]))
        asked = dict.fromkeys(names, int(part["trial"].max()) + 1)
        cells[scenario] = {"experiment": experiment, "baseline": names[0], "estimators": asked}
    manifest = {
        **{"format": 1, "study": {"name": "made up", "about": "nothing was run", **study}, "cells": cells, "seed": 3},
        **{"data": None, "scenarios": {scenario: {"ticks": 10} for scenario in cells}, "streams": {}, "cpu": "one"},
        **{"versions": {"cooploc": "0", "python": "3"}, "source": "abc", "commit": None, "files": {}},
    }
    return StoredRun(folder, manifest, rows, {})
