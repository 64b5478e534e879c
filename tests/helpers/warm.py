"""Imported once by the server that `processes` forks from: imports what commands import, and loads compiled loops.

A process that is forked from it begins where one that is started is after seconds of imports.
"""

import contextlib
import io
import os
import sys
import tempfile
from pathlib import Path

STUDY = """
trials = 6
baseline = "dead-reckoning"
scenarios = ["robots-1-3/n={1,2}[ticks=3]"]
estimators = ["dead-reckoning", "ekf-local", "arl[particles=50]"]
"""


def run_once():
    """A small study from the study's file to the picture."""
    from cooploc.__main__ import main

    before, argv = Path.cwd(), sys.argv
    with tempfile.TemporaryDirectory() as folder, contextlib.redirect_stdout(io.StringIO()):
        try:
            os.chdir(folder)
            Path("small.toml").write_text(STUDY)
            sys.argv = ["cooploc", "run", "small.toml", "--out", "run"]
            main()
        except SystemExit:
            pass  # what is wrong with it, the tests will find
        finally:
            os.chdir(before)
            sys.argv = argv


run_once()
