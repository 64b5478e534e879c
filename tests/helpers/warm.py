"""Imported once by the server that `processes` forks from: imports what commands import, and loads compiled loops."""

import tempfile
from pathlib import Path

from processes import inside

STUDY = """
trials = 6
baseline = "dead-reckoning"
scenarios = ["robots-1-3/n={1,2}[ticks=3]"]
estimators = ["dead-reckoning", "ekf-local", "arl[particles=50]"]
"""

with tempfile.TemporaryDirectory() as folder:
    (Path(folder) / "small.toml").write_text(STUDY)
    inside("run", "small.toml", "--out", "run", cwd=folder)
