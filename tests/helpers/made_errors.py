"""Tables of errors that were never measured, for tests of what is made of them."""

import numpy as np
import pandas as pd

from cooploc.analysis.metrics.errors import COLUMNS


def rows(estimator, mse, *, anees=1.0, scenario="s", stream="h", ticks=10):
    """One row per (trial, robot) of `mse` (trials, robots)."""
    t, n = np.shape(mse)
    trial = np.repeat(np.arange(t), n)
    same = {"mean_error": 1.0, "median_error": 0.9, "max_error": 3.0, "final_error": 1.1, "coverage95": 0.9}
    same |= {"diverged": 0.0, "messages": 1.0, "bytes": 48.0, "seconds": 1e-4, "centralised": False, "bound": False}
    frame = pd.DataFrame({"trial": trial, "robot": np.tile(np.arange(n), t), "mse": np.ravel(mse), **same})
    frame = frame.assign(scenario=scenario, estimator=estimator, robots=n, ticks=ticks, anees=anees)
    frame["stream"] = [f"{stream}{k}" for k in trial]
    return frame.reindex(columns=list(COLUMNS))


BASE = np.random.default_rng(0).lognormal(0, 0.4, (12, 3))
