"""Runs that were never run, and the outline of a page: what tests of reports, tables and comparisons share."""

from html.parser import HTMLParser

import numpy as np
import pandas as pd

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
    rng = np.random.default_rng(7)
    noise = rng.uniform(0.8, 1.2, (trials, len(estimators)))
    frames = []
    for i, (name, (rmse, anees)) in enumerate(estimators.items()):
        mse = rmse**2 * noise[:, i]
        frame = pd.DataFrame(
            {
                "scenario": scenario,
                "estimator": name,
                "trial": range(trials),
                "robot": 0,
                "robots": 1,
                "ticks": 10,
                "mse": mse,
                "rmse": np.sqrt(mse),
                **dict.fromkeys(("mean_error", "median_error", "max_error", "final_error"), np.sqrt(mse)),
                "anees": anees * noise[::-1, i],
                "coverage95": 0.9,
                "diverged": 0.0,
                "pose_nees": np.nan,
                "messages": 1.0,
                "bytes": 48.0 + i,
                "seconds": 1e-4 * (1 + i),
                "centralised": name in bounds,
                "bound": name in bounds,
                "stream": [f"{scenario}{trial}" for trial in range(trials)],
                "failure": None,
                "traceback": None,
            }
        )
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
        "format": 1,
        "study": {"name": "made up", "about": "nothing was run", **study},
        "cells": cells,
        "seed": 3,
        "data": None,
        "scenarios": {scenario: {"ticks": 10} for scenario in cells},
        "streams": {},
        "versions": {"cooploc": "0", "python": "3"},
        "source": "abc",
        "commit": None,
        "cpu": "one",
    }
    return StoredRun(folder, manifest, rows, {})
