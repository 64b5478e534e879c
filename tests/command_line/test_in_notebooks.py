"""What a notebook shows of progress, of mistakes and of results: one place, one line, the command line's table."""

import re
import sys
from contextlib import chdir
from types import SimpleNamespace

import pandas as pd
import pytest

import cooploc as cl
from cooploc.analysis.report.result_tables import lowest_that_qualifies
from cooploc.estimators.dead_reckoning import DeadReckoning
from cooploc.terminal import console


class Strange(Exception):
    """Of a class that the process of a plug-in does not share."""


class Raises(DeadReckoning):
    def __init__(self, error=ValueError):
        object.__setattr__(self, "error", error)

    def predict(self, s, z):
        raise self.error("oops")


@pytest.mark.parametrize("ended", [None, KeyboardInterrupt])
def test_progress_is_one_output_that_is_empty_at_the_end_or_says_how_to_go_on(monkeypatch, ended):
    shown = []
    handle = SimpleNamespace(update=lambda bundle, raw: shown.append(bundle))
    display = SimpleNamespace(display=lambda bundle, raw, display_id: handle)
    monkeypatch.setitem(sys.modules, "IPython.display", display)
    monkeypatch.setattr(console, "SHOW_EVERY", 0)
    progress = console.TerminalProgress()
    progress._console.is_jupyter = True
    with progress:
        progress.begin(8, 0)
        for _ in range(2):
            progress.advance("quick · <b> · arl", 2, 0)
    progress.__exit__(ended)
    assert shown[1]["text/plain"].startswith("4 of 8 trials (quick · <b> · arl)")
    assert shown[1]["text/html"].startswith(
        '<progress value="0.500"></progress> 4 of 8 trials (quick · &lt;b&gt; · arl)'
    )
    assert shown[-1]["text/plain"] == (
        "interrupted: what was finished is kept, and the same call goes on from there" if ended else ""
    )


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda: cl.simulate("nols"), "did you mean 'nlos'"),
        (lambda: cl.run_study("quick", estimators=["arl", Raises]), "%%writefile mine.py"),
        (lambda: cl.tune("quick", estimators={"mine": "arl"}), "a study takes estimators by name"),
        (lambda: cl.plot.rmse("runs"), "the table that cl.errors returns"),
        (lambda: cl.verdicts(pd.DataFrame({"claim": [1]})), "the table that cl.errors returns"),
        (lambda: cl.show(3), "this is of type int: cl.show prints"),
        (lambda: cl.inspect(pd.DataFrame()), "path is a DataFrame: write CSV files into a folder, and name it"),
        (lambda: cl.run([], None), "the second argument is a NoneType"),
        (lambda: cl.run({}, cl.simulate("trajectory[ticks=1]")[1]), "there is no estimator to run"),
        (lambda: cl.run("arl", cl.simulate("trajectory[ticks=1]")[1], jobs="2"), "it must be a whole number"),
    ],
)
def test_a_mistake_is_one_line(call, said):
    with pytest.raises(cl.BadInput, match=said) as e:
        call()
    *places, line = e.value._render_traceback_()
    assert line == f"BadInput: {e.value}"
    assert [place.partition(",")[0] for place in places] == ["test_in_notebooks.py"] * 2  # the call, and the lambda


@pytest.mark.slow
@pytest.mark.parametrize(("error", "line"), [(ValueError, "ValueError: oops"), (Strange, "Strange: oops")])
def test_an_error_of_an_estimator_shows_its_own_lines_alone(error, line):
    stream = cl.simulate("trajectory[ticks=2]", trials=1)[1]
    with pytest.raises((ValueError, cl.EstimatorError)) as e:
        cl.run({"mine": Raises(error)}, stream)
    place, said, debug = e.value._render_traceback_()
    assert re.fullmatch(r'test_in_notebooks.py, line \d+, in predict: raise self.error\("oops"\)', place)
    assert said == line
    assert "isolate=False" in debug


@pytest.mark.slow
def test_what_a_function_returned_is_shown_as_the_command_line_does(capsys):
    truth, stream = cl.simulate("trajectory[ticks=4]", trials=6)
    errors = cl.errors(truth, cl.run(["arl", "mrsl-rssi"], stream))
    cl.show(cl.compare(errors, baseline="arl", full=True))
    assert "trajectory[ticks=4]: 3 robots, 6 trials" in capsys.readouterr().out
    cl.show(cl.verdicts(errors))
    assert "Not run at all" in capsys.readouterr().out
    with pytest.raises(cl.BadInput, match="this is another table"):
        cl.show(errors)


@pytest.mark.slow
def test_results_are_the_tables_of_the_command_line_with_what_it_says_below(tmp_path):
    (tmp_path / "bad.py").write_text(
        "from cooploc.estimators.dead_reckoning import DeadReckoning\n\n\n"
        "class Bad(DeadReckoning):\n    def predict(self, s, z):\n        raise ValueError('<i>')\n"
    )
    study = 'trials = 6\nbaseline = "arl"\nscenarios = ["trajectory[ticks=4]"]\n'
    (tmp_path / "s.toml").write_text(f'{study}estimators = ["dead-reckoning", "arl", "ekf-local", "bad.py:Bad"]\n')
    with chdir(tmp_path):
        results = cl.run_study("s.toml", out="run", check=False, isolate=False)
        text = results._repr_html_()
    assert (text.count("<table>"), text.count("<tr>")) == (1, 5)
    assert "<i>" not in text
    assert "failed: ValueError: &lt;i&gt; (bad.py:6)" in text
    assert "in one process" in text
    table = results.table.sort_values("rmse")
    places = [text.index(f">{name}<") for name in table["estimator"].str.replace("bad.py:", "") if f">{name}<" in text]
    assert places == sorted(places)
    best = lowest_that_qualifies(table.to_dict("records"))
    bold = [row for row in text.split("<tr>")[2:] if "font-weight:bold" in row]
    assert best is not None
    assert [f">{best['estimator']}<" in row for row in bold] == [True]


def test_a_sweep_takes_the_numbers_of_trials_too():
    swept = cl.sweep("packet-drop[ticks=3]", "dead-reckoning", trials=[2, 5], drop={0, 0.5})
    assert set(swept["trial"]) == {2, 5}
