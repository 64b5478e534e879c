"""What a user types after `cl.`: the names that are shown, the lists, and whole studies from Python."""

import re
import subprocess
import sys
from importlib import import_module
from types import ModuleType

import pandas as pd
import pytest

import cooploc as cl
from cooploc.analysis.claims.verdicts import COLUMNS
from cooploc.cli import app

STUDY = 'trials = 6\nbaseline = "arl"\nscenarios = ["trajectory[ticks=6]"]\nestimators = ["arl", "ekf-local"]\n'


def test_dir_shows_what_users_call_and_an_unknown_name_is_an_attribute_error():
    import_module("cooploc.terminal.tables")  # a submodule that was imported is not shown
    shown = [name for name in dir(cl) if not name.startswith("_")]
    assert sorted(shown) == sorted(cl.__all__)
    assert {name for name in shown if isinstance(getattr(cl, name), ModuleType)} == {"estimators", "scenarios", "plot"}
    assert all(callable(getattr(cl, name)) for name in set(shown) - {"plot"})
    with pytest.raises(AttributeError, match="module 'cooploc' has no attribute 'simulat'"):
        _ = cl.simulat


@pytest.mark.slow
@pytest.mark.parametrize("then", ["", ", importlib; importlib.reload(cl.estimators); importlib.reload(cl)"])
def test_estimators_and_scenarios_are_listed_and_are_packages_in_any_order_of_imports(then):
    program = (
        f"import cooploc as cl{then}\n"
        "assert cl.list_estimators().name[0] == 'dead-reckoning' and cl.list_scenarios().name[0] == 'robots-1-3'\n"
        "assert callable(cl.estimators.make) and cl.scenarios.simulate is cl.simulate\n"
        "import cooploc.estimators as e, cooploc.scenarios as s\n"
        "assert e is cl.estimators and s is cl.scenarios"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("kind", ["estimators", "scenarios", "studies", "problems"])
def test_the_old_names_of_lists_warn_and_give_the_same(kind):
    with pytest.warns(FutureWarning, match=f"cl.{kind}.* is called cl.list_{kind}.* now"):
        old = getattr(cl, kind)()
    pd.testing.assert_frame_equal(old, getattr(cl, f"list_{kind}")())


def test_lists_say_what_there_is():
    estimators, scenarios, studies = (
        table.set_index("name") for table in (cl.list_estimators(), cl.list_scenarios(), cl.list_studies())
    )
    assert all((table["about"] != "").all() for table in (estimators, scenarios, studies))
    assert estimators.index[estimators["centralised"]].tolist() == ["ekf-joint", "iekf-joint", "ukf-joint", "map-joint"]
    assert estimators.index[estimators["bound"]].tolist() == ["map-joint"]
    assert estimators.loc["mrsl-rssi", "uses"] == "odometry, anchor_rssi|landmark|anchor_range, radio_rssi"
    assert estimators.loc["ctrn", "source"].endswith("ICRA 2020")
    assert scenarios.loc["packet-drop", "labels"] == "packet-drop/drop=…"
    assert "ticks" in scenarios.loc["packet-drop", "parameters"].split(", ")
    assert "IJRR" in scenarios.loc["mrclam", "source"] == studies.loc["mrclam", "source"]
    assert studies.loc["paper", "minutes"] > studies.loc["quick", "minutes"] > 0


def test_a_broken_plugin_is_listed_with_its_problem(tmp_path, monkeypatch):
    info = tmp_path / "broken-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: broken\nVersion: 1.0\n")
    points = "[cooploc.estimators]\nbroken = no_such_module:X\n[cooploc.scenarios]\nlost = no_such_module:Y\n"
    (info / "entry_points.txt").write_text(points)
    monkeypatch.syspath_prepend(tmp_path)
    for table, name in ((cl.list_estimators(), "broken"), (cl.list_scenarios(), "lost")):
        problems = table.set_index("name")["problem"]
        assert "no_such_module" in problems[name]
        assert (problems.drop(name) == "").all()


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    folder = tmp_path_factory.mktemp("api")
    (folder / "small.toml").write_text(STUDY)
    return folder


@pytest.fixture(scope="module")
def results(place):
    return cl.run_study(place / "small.toml", out=place / "run")


@pytest.mark.slow
def test_run_study_keeps_rows_table_and_picture_and_load_run_reads_them(results, place):
    assert len(results.rows) == 2 * 6 * 3
    pd.testing.assert_frame_equal(results.table, cl.compare(results.rows, baseline="arl", full=True))
    assert results.failures.empty
    assert {"manifest.json", "table.csv", "rmse.png"} <= {file.name for file in (place / "run").iterdir()}
    assert "1 scenario, 2 estimators" in repr(results)
    assert "ekf-local" in results._repr_html_()
    loaded = cl.load_run(place / "run")
    pd.testing.assert_frame_equal(loaded.rows, results.rows)
    pd.testing.assert_frame_equal(loaded.table, results.table)
    options = {"trials": 2, "estimators": ["ekf-local"], "jobs": 2}
    some = cl.run_study(str(place / "small.toml"), **options, out=place / "some").rows
    first = results.rows.query("trial < 2 and estimator == 'ekf-local'").reset_index(drop=True)
    pd.testing.assert_frame_equal(some.drop(columns="seconds"), first.drop(columns="seconds"))


@pytest.mark.slow
def test_verdicts_are_the_same_of_results_of_a_folder_and_of_rows(results, place):
    (place / "ledger.toml").write_text(
        'paper = "A"\n[[claims]]\nid = "1"\nsays = "better"\nkind = "change"\nof = "ekf-local"\nthan = "arl"\n'
        'scenarios = "trajectory[ticks=6]"\n'
    )
    found = cl.verdicts(results, place / "ledger.toml")
    assert list(found) == [*COLUMNS, "map", "sentence"]
    assert found["sentence"].str.startswith("trajectory[ticks=6]: the RMSE of ").all()
    for other in (place / "run", str(place / "run"), results.rows):
        pd.testing.assert_frame_equal(cl.verdicts(other, place / "ledger.toml"), found)


def without_links(page):
    return re.sub("</?a[ >][^<]*?>|</?a>", "", page.read_text("utf-8"))


@pytest.mark.slow
def test_a_report_is_written_and_its_trials_are_reproduced(results, place):
    page = cl.report(results)
    assert page == place / "run" / "report" / "index.html"
    elsewhere = cl.report(place / "run", out=place / "elsewhere")  # names the run's files, and does not link them
    assert without_links(elsewhere) == without_links(page)
    found = cl.reproduce(page, trials=2)
    assert (found.equal, len(found.table), found.differences) == (True, 4, [])
    with pytest.raises(cl.BadInput, match="trials is 0; it must be at least 1"):
        cl.reproduce(page, trials=0)


def test_every_command_is_a_function_too():
    functions = {"run": "run_study", "check": "check_estimator", "compare": "compare_runs", "problems": "list_problems"}
    commands = [command.name or command.callback.__name__ for command in app.registered_commands]
    assert {functions.get(name, name) for name in commands if name != "list"} <= set(cl.__all__)


@pytest.mark.parametrize("read", [cl.load_run, cl.report, cl.verdicts, lambda run: cl.compare_runs(run, run)])
def test_what_is_no_run_is_refused_in_one_line(read):
    with pytest.raises(cl.BadInput, match=r"a run is given by its directory, .* not as int"):
        read(3)


@pytest.mark.slow
def test_a_run_is_not_compared_with_itself(tmp_path):
    (tmp_path / "s.toml").write_text(
        'about = "a"\ntrials = 1\nscenarios = ["trajectory[ticks=2]"]\nestimators = ["arl"]\n'
    )
    run = cl.run_study(tmp_path / "s.toml", out=tmp_path / "run")
    with pytest.raises(cl.BadInput, match=r"both runs are .*run: give each a directory of its own by --out"):
        cl.compare_runs(run, tmp_path / "run")


@pytest.mark.slow
def test_a_sweep_in_braces_is_several_estimators_wherever_names_are_listed():
    stream = cl.simulate("trajectory[ticks=2]")[1]
    labels = ["arl", "mrsl-rssi[particles=10]", "mrsl-rssi[particles=20]"]
    for listed in (["arl", "mrsl-rssi[particles={10,20}]"], "arl, mrsl-rssi[particles={10,20}]"):
        assert list(cl.run(listed, stream).traces) == labels
    with pytest.raises(cl.BadInput, match="a single value"):
        cl.run({"mine": "mrsl-rssi[particles={10,20}]"}, stream)


def test_a_parameter_is_called_as_in_labels_or_as_in_the_table():
    for label, named in (("scalability", {"n": 2}), ("scalability", {"robots": 2}), ("scalability[n=2]", {})):
        assert cl.simulate(label, **named)[1].robots == 2
