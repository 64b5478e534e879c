"""The command line, as a user calls it: exit codes, one clear line, JSON that is JSON."""

import json
import subprocess
import sys
from functools import partialmethod

import pytest
from processes import HANGS, inside

import cooploc as cl
from cooploc.__main__ import _explain
from cooploc.terminal.console import PlainConsole

SMALL = 'trials = 6\nbaseline = "arl"\nscenarios = ["trajectory[ticks=10]"]\nestimators = ["arl", "ekf-joint"]\n'


def cooploc(*arguments, cwd):
    """As it is installed, and as a user calls it; `inside` does the same without a process."""
    return subprocess.run(
        [sys.executable, "-m", "cooploc", *arguments], capture_output=True, text=True, cwd=cwd, timeout=HANGS
    )


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    folder = tmp_path_factory.mktemp("cli")
    (folder / "small.toml").write_text(SMALL)
    return folder


@pytest.fixture(scope="module")
def ran(place):
    return inside("run", "small.toml", "--out", "run", cwd=place)


def test_run_prints_a_table_and_writes_a_picture_and_says_where(place):
    told = cooploc("run", "small.toml", "--out", "installed", cwd=place)
    assert told.returncode == 0, told.stderr
    for word in ("trajectory[ticks=10]", "arl", "ekf-joint", "RMSE", "centralised", "installed/rmse.png"):
        assert word in told.stdout
    assert (place / "installed" / "rmse.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.slow
def test_json_is_the_only_thing_on_stdout_and_has_the_fields_of_the_csv_file(ran, place):
    told = inside("run", "small.toml", "--out", "run", "--json", cwd=place)
    rows = json.loads(told.stdout)
    head = (place / "run" / "table.csv").read_text(encoding="utf-8").splitlines()[0]
    assert [list(row) for row in rows] == [head.split(",")] * 2
    assert rows[0]["trials"] == 6
    assert rows[0]["rmse_low"] < rows[0]["rmse"] < rows[0]["rmse_high"]
    few = json.loads(inside("run", "small.toml", "--trials", "2", "--json", cwd=place).stdout)
    assert few[0]["rmse_low"] is None


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["run", "quik"], "there is no study 'quik'; did you mean 'quick'?"),
        (["run", "nlos/n=2"], "nlos/n=2 is a scenario: name the estimators that run there, such as --estimators arl"),
        (["run", "nlos/m=2", "--estimators", "arl"], "scenario 'nlos' has no 'm=2'; known are bias=..., n=..."),
        (["run", "nothing.toml"], "there is no file nothing.toml; check its path"),
        (["run", "quick", "--trials", "many"], "--trials"),
        (["run", "quick", "--seed", "-1"], "seed: it must be at least 0, not -1"),
        (["run", "quick", "--estimators", ","], "estimators is empty"),
        (["run", "quick", "--until-decided", "--trials", "5"], "give max_trials alone (--max-trials)"),
        (["run", "quick", "--until-decided", "--max-trials", "0"], "trials"),
        (["run", "quick", "--nonsense"], "--nonsense"),
        (["run", "mrclam", "--data", "no-such-directory"], "no-such-directory"),
        (["run", "quick", "--data", "nowhere"], "nowhere: there is no such directory; name the one that holds"),
        (["run", "small.toml", "--out", "small.toml"], "small.toml exists and is not a run directory"),
        (["tune", "quick", "--budget", "0"], "must be at least 1 trial"),
        (["tune", "quick", "--budget", "2"], "give at least --budget 3"),
        (["tune", "mrclam", "--budget", "9"], "is a recording"),
        (["check", "arll"], "did you mean 'arl'?"),
        (["check", "mine.py:Mine"], "mine.py"),
        (["list", "things"], "nothing is called 'things'"),
        (["list", "trajectori"], "did you mean 'trajectory'"),
        (["fly"], "No such command 'fly'"),
        (["report", "nowhere"], "nowhere holds no run"),
        (["report", "small.toml"], "small.toml exists and is not a run directory"),
        (["report", "run", "--ledger", "small.toml"], "small.toml: there is no key 'trials'"),
        (["compare", "run", "nowhere"], "nowhere holds no run"),
        (["reproduce", "nowhere"], "cannot be read"),
        (["judge", "trajectory", "--tum", "a", "--align", "se2"], "--within go with --truth"),
        (["judge", "--truth", "a", "--tum", "a", "--trials", "2"], "--offline go with a stream"),
        (["reproduce", "run", "--trials", "0"], "--trials"),
        (["plan", "arena-3@1"], "arena-3@1 fixes its trials, so that there is nothing to plan"),
    ],
)
def test_bad_input_exits_2_with_one_line(place, ran, arguments, said):
    told = inside(*arguments, cwd=place)
    assert (told.returncode, told.stdout, told.stderr.count("\n")) == (2, "", 1), told.stderr
    assert said in told.stderr


def test_what_the_system_refuses_is_one_line_with_a_remedy():
    assert (
        _explain(PermissionError(13, "Permission denied", "r"))
        == "Permission denied: r; ask for access, or name another place"
    )
    assert (_explain(OSError(28, "No space left on device")) or "").endswith("the same command goes on from there")
    assert _explain(KeyError("a fault of ours")) is None


@pytest.mark.slow
def test_check_passes_a_builtin_and_fails_a_broken_file(place):
    assert inside("check", "dead-reckoning").returncode == 0
    (place / "broken.py").write_text(
        "import numpy as np\n"
        "from cooploc.estimators.dead_reckoning import DeadReckoning\n"
        "class Broken(DeadReckoning):\n"
        "    def estimate(self, s):\n"
        "        return super().estimate(s)._replace(x=s.x + np.random.normal(size=s.x.shape))\n"
    )
    told = inside("check", "broken.py:Broken", cwd=place)
    assert told.returncode == 1, told.stderr
    assert "failed" in told.stdout


def test_a_list_in_a_pipe_is_as_wide_as_a_page(tmp_path):
    lines = inside("list", "estimators", cwd=tmp_path).stdout.splitlines()
    assert 80 < max(map(len, lines)) <= 100


@pytest.mark.parametrize(
    ("name", "said"),
    [
        (
            "ctrn[criterion=det]",
            ("estimator ctrn", "weights: ", "criterion=det, ", "odometry, anchor_rssi or", "Wiktor"),
        ),
        ("packet-drop", ("five robots that lose", "share of packets", "study packet-drop", "drop={0,0.3,0.5,")),
        ("robots-1-3/n=2[eta=2]", (" robots              2 ", " eta                 2 ", "path-loss exponent")),
        ("mrclam/one", ("five real robots", " sigma_bearing   0.02   rad ")),
        ("arena-3@1", ("5a514eeed05fa98c",)),
        ("dead-reckoning", ("values: it has no parameters",)),
        (
            "w.py:Office/n=7",
            ("scenario w.py:Office/n=7: an office", "labels: w.py:Office/n=", " robots              7 "),
        ),
    ],
)
def test_a_name_is_explained_with_its_parameters(name, said, tmp_path, monkeypatch, capsys):
    world = "from cooploc.scenarios import PAPER, Family\nOffice = Family('an office', PAPER, sweep={'n': 'robots'})\n"
    (tmp_path / "w.py").write_text(world)
    told = inside("list", name, cwd=tmp_path).stdout
    assert all(words in told for words in said), told
    monkeypatch.chdir(tmp_path)
    cl.show(name)
    assert capsys.readouterr().out == told


@pytest.mark.slow
@pytest.mark.parametrize(
    ("module", "heavy"),
    [
        ("cooploc.cli", ("numpy", "pandas", "numba", "cvxpy", "scipy", "seaborn")),
        ("cooploc.api", ("matplotlib", "seaborn", "scipy.stats", "scipy.optimize", "statsmodels", "optuna", "cvxpy")),
    ],
)
def test_nothing_is_imported_that_only_figures_or_tests_need(module, heavy):
    program = f"import sys, {module}; print([m for m in {heavy} if m in sys.modules])"
    told = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert told.stdout.strip() == "[]", told.stderr


@pytest.mark.slow
@pytest.mark.parametrize("width", [80, 110, 160])
def test_a_terminals_table_has_every_estimator_and_no_line_beyond_its_width(ran, place, width, monkeypatch):
    terminal = partialmethod(PlainConsole.__init__, width=width, force_terminal=True, color_system=None)
    monkeypatch.setattr(PlainConsole, "__init__", terminal)  # the class itself others may import and keep
    for options in ((), ("--wide",)):
        told = inside("run", "small.toml", "--out", "run", *options, cwd=place)
        assert "ekf-joint" in told.stdout
        lines = [line for line in told.stdout.splitlines() if not line.startswith(("picture", "table", "next"))]
        assert all(len(line) <= width for line in lines)
        assert ("not shown at this width" in told.stdout) == (bool(options) and width < 160)
        assert ("ANEES" in told.stdout) == bool(options)


@pytest.mark.slow
def test_tables_in_a_pipe_are_as_wide_as_a_page_and_legends_are_for_who_asks(ran, place):
    for command in (("run", "small.toml", "--out", "run"), ("check", "ekf-ci")):
        tables = [line for line in inside(*command, cwd=place).stdout.splitlines() if line.startswith(" ")]
        assert 60 < max(map(len, tables)) <= 100, command
    wide, legend = (inside("run", "small.toml", "--out", "run", f"--{o}", cwd=place).stdout for o in ("wide", "legend"))
    assert max(map(len, wide.splitlines())) > 120
    assert all(words in legend for words in ("every reading reaches one computer", "vs: change of RMSE on the same"))
    assert "every reading reaches one computer" not in wide
