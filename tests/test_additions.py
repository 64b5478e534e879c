"""One line adds an estimator, a world, a recording or its format, a statistic or a figure: tried in a copy."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
ESTIMATOR = '''"""An estimator that stands still.

Source: the contributor's guide, 2026.
"""

from dataclasses import dataclass

from cooploc.estimators.dead_reckoning import DeadReckoning, State
from cooploc.estimators.interface import Senses


@dataclass(frozen=True)
class Still(DeadReckoning):
    """The prior, for ever."""

    def predict(self, s: State, z: Senses) -> State:
        """Return the same belief."""
        return s
'''
WORLD = '''"""The radio arena, by another name.

Source: the contributor's guide, 2026.
"""

from cooploc.scenarios.worlds.radio import Paper


class Hall(Paper):
    """A larger arena."""

    side: float = 9.0
'''
FORMAT = '''"""Recordings of one robot on a straight line."""

from pathlib import Path

import numpy as np

from cooploc.scenarios.recordings.schema import TeamDescription
from cooploc.scenarios.recordings.team_log import Places, Series, TeamLog


def find_runs(data: Path, description: TeamDescription) -> dict[str, Path]:
    """Return every run by name."""
    return {path.stem: path for path in sorted(data.glob("*.line"))}


def read_run(place: Path, name: str, description: TeamDescription) -> TeamLog:
    """Read the speed [m/s] of a minute."""
    time, nowhere = np.arange(0.0, 60.0, 0.1), Places((), np.empty((0, 2)))
    along, still = float(place.read_text()) * time, np.zeros_like(time)
    truth = Series(time, np.stack([along, still, still], -1), place.name)
    return TeamLog(name, ("red",), "pose", (truth,), (truth,), {}, nowhere, nowhere)
'''
ADDITIONS = {
    "scenarios/recordings/line.py": FORMAT,
    "estimators/still.py": ESTIMATOR,
    "scenarios/worlds/hall.py": WORLD,
}
LINES = {  # file -> a line that stands there, and the one that is added before it
    "estimators/__init__.py": ('    "map-joint": (', '    "still": ("cooploc.estimators.still:Still", {}),\n'),
    "scenarios/__init__.py": (
        '    "mrclam": Family(',
        '    "hall": Family("a larger arena", "cooploc.scenarios.worlds.hall:Hall"),\n'
        '    "tape": Family("a recording of robots", "cooploc.scenarios.recordings.mrclam:Mrclam", recorded=True),\n',
    ),
    "scenarios/recordings/schema.py": ('    "mrclam": "mrclam",', '    "line": "line",\n'),
    "analysis/metrics/compare.py": (
        '    "mean_error": Statistic(',
        '    "largest_error": Statistic("largest error of a trial", lambda cell: cell.trials["mean_error"].max()),\n',
    ),
    "analysis/plot/results.py": (
        "def rmse(",
        'def trials_drawn(errors: "pd.DataFrame", ax: Axes | None = None) -> Axes:\n'
        '    """Draw the number of trials of each estimator."""\n'
        '    return errors.groupby("estimator")["trial"].nunique().plot.bar(ax=ax)\n\n\n',
    ),
    "analysis/plot/__init__.pyi": (
        "from cooploc.analysis.plot.studies import claims",
        "from cooploc.analysis.plot.results import trials_drawn as trials_drawn\n",
    ),
}
USE = """
from pathlib import Path
import cooploc as cl
from cooploc.scenarios.recordings.scenario import TeamFolder
Path("straight").mkdir()
Path("straight/fast.line").write_text("2.0")
Path("straight/log.toml").write_text('format = "line"')
assert TeamFolder(Path("straight")).log("fast").truth[0].source == "fast.line"
assert "still" in set(cl.list_estimators()["name"]) and {"hall", "tape"} <= set(cl.list_scenarios()["name"])
truth, stream = cl.simulate("hall", trials=3, ticks=5)
errors = cl.errors(truth, cl.run("still,dead-reckoning", stream))
assert "largest_error" in cl.compare(errors, baseline="dead-reckoning", full=True)
assert cl.plot.trials_drawn(errors).get_title() == "" and "trials_drawn" in dir(cl.plot)
assert cl.check_estimator("still")["determinism"].status == "passed"
"""


@pytest.fixture(scope="module")
def copy(tmp_path_factory):
    root = tmp_path_factory.mktemp("copy") / "source"
    shutil.copytree(
        ROOT,
        root,
        symlinks=True,
        ignore=shutil.ignore_patterns(".git", ".venv*", "build", "runs", ".*_cache", ".hypothesis", "data"),
    )
    for file, text in ADDITIONS.items():
        (root / file).write_text(text)
    for file, (before, added) in LINES.items():
        text = (root / file).read_text()
        assert text.count(before) == 1, (file, before)
        (root / file).write_text(text.replace(before, added + before))
    return root


def run(copy, *command):
    environment = {**os.environ, "PYTHONPATH": str(copy), "MPLBACKEND": "agg"}
    done = subprocess.run([sys.executable, *command], cwd=copy, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.slow
def test_one_line_each_is_enough_to_use_them(copy):
    run(copy, "-c", USE)


@pytest.mark.slow
def test_lint_contracts_and_the_tests_of_all_estimators_pass_with_them(copy):
    run(copy, "-m", "ruff", "check", "estimators", "scenarios", "analysis/metrics", "analysis/plot")
    run(copy, "-c", "from importlinter.cli import lint_imports; raise SystemExit(lint_imports(no_cache=True))")
    pytest_quick = ("-m", "pytest", "-q", "-p", "no:randomly", "-p", "no:xdist", "-m", "not slow")
    of_all = ("tests/command_line", "tests/analysis/plot/test_style.py", "tests/estimators", "tests/scenarios/worlds")
    run(copy, *pytest_quick, "-k", "still or hall or list or test_style", *of_all)
