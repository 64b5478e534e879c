"""What a notebook shows: a bar while a run goes on, with a stand-in for IPython, and well-formed tables."""

import sys
from types import SimpleNamespace
from xml.etree import ElementTree

import pytest

import cooploc as cl
from cooploc.scenarios import display


@pytest.fixture
def shown(monkeypatch):
    """What a notebook shows, in turn."""
    pictures = []

    def show(data, raw, display_id=True):
        pictures.append(data["text/html"])
        return SimpleNamespace(update=show)

    shell = SimpleNamespace(kernel=object())
    monkeypatch.setitem(sys.modules, "IPython", SimpleNamespace(get_ipython=lambda: shell))
    monkeypatch.setitem(sys.modules, "IPython.display", SimpleNamespace(display=show))
    monkeypatch.setattr(display, "PATIENCE", 0.0)
    monkeypatch.setattr(display, "EVERY", 0.0)
    return pictures


@pytest.fixture
def team():
    return {"arl": cl.make("arl", particles=20), "<b>": cl.make("ekf-local")}


@pytest.mark.parametrize(("jobs", "pictures"), [(1, 10), (2, 4)])
def test_a_notebook_shows_a_bar_that_fills_and_goes(shown, team, jobs, pictures):
    cl.run(team, cl.simulate("trajectory", trials=2, ticks=5, seed=1)[1], jobs=jobs)
    *bars, last = shown
    steps = [int(bar.split('value="')[1].split('"')[0]) for bar in bars]
    assert last == ""
    assert steps == sorted(steps)
    assert (steps[-1], len(steps)) == (10 * jobs, pictures)
    assert any("&lt;b&gt;, about " in bar for bar in bars)


def test_nothing_is_shown_outside_a_notebook(shown, team, monkeypatch, capfd):
    monkeypatch.delitem(sys.modules, "IPython")
    cl.run(team, cl.simulate("trajectory", trials=2, ticks=5, seed=1)[1])
    assert shown == []
    assert capfd.readouterr() == ("", "")


def test_the_bar_goes_when_a_run_fails(shown, team):
    object.__setattr__(team["<b>"], "fuse", lambda *_: None)
    with pytest.raises(cl.EstimatorError):
        cl.run(team, cl.simulate("trajectory", trials=1, ticks=3, seed=1)[1])
    assert shown[0].startswith("<progress")
    assert shown[-1] == ""


def test_a_table_of_a_stream_and_of_a_run_is_well_formed():
    stream = cl.simulate("packet-drop/drop=0.7", trials=2, seed=1, ticks=8)[1]
    run = cl.run({"<b>&": cl.make("ekf-naive"), "ekf-joint": cl.make("ekf-joint")}, stream)
    for held, expected in ((stream, {stream.hash[:16]}), (run, {"<b>&", "ekf-joint", "48", "centralised"})):
        table = ElementTree.fromstring(held._repr_html_())
        cells = " ".join("".join(cell.itertext()) for cell in table.iter() if cell.tag in ("td", "th", "caption"))
        assert all(one in cells for one in expected)
