"""The bar of a run in a notebook, with a stand-in for IPython."""

import sys
from types import SimpleNamespace

import pytest

import cooploc as cl
from cooploc.scenarios import display


class Handle:
    def __init__(self, shown):
        self.shown = shown

    def update(self, data, raw):
        self.shown.append(data["text/html"])


@pytest.fixture
def shown(monkeypatch):
    """What a notebook shows, in turn."""
    pictures = []

    def show(data, raw, display_id):
        pictures.append(data["text/html"])
        return Handle(pictures)

    shell = SimpleNamespace(kernel=object())
    monkeypatch.setitem(sys.modules, "IPython", SimpleNamespace(get_ipython=lambda: shell))
    monkeypatch.setitem(sys.modules, "IPython.display", SimpleNamespace(display=show))
    monkeypatch.setattr(display, "PATIENCE", 0.0)
    monkeypatch.setattr(display, "EVERY", 0.0)
    return pictures


def team():
    return {"arl": cl.make("arl", particles=20), "<b>": cl.make("ekf-local")}


@pytest.mark.parametrize("jobs", [1, 2])
def test_a_notebook_shows_a_bar_that_fills_and_goes(shown, jobs):
    _, stream = cl.simulate("trajectory", trials=2, ticks=5, seed=1)
    cl.run(team(), stream, jobs=jobs)
    *bars, last = shown
    assert last == ""
    steps = [int(bar.split('value="')[1].split('"')[0]) for bar in bars]
    assert steps == sorted(steps)
    assert steps[-1] == 10 * jobs
    assert len(steps) == (10 if jobs == 1 else 4)
    assert all(f'max="{10 * jobs}"' in bar and " left" in bar for bar in bars)
    assert any("&lt;b&gt;, about " in bar for bar in bars)


def test_nothing_is_shown_outside_a_notebook(shown, monkeypatch, capfd):
    _, stream = cl.simulate("trajectory", trials=2, ticks=5, seed=1)
    monkeypatch.delitem(sys.modules, "IPython")
    cl.run(team(), stream)
    assert shown == []
    assert capfd.readouterr() == ("", "")


def test_the_bar_goes_when_a_run_fails(shown):
    _, stream = cl.simulate("trajectory", trials=1, ticks=3, seed=1)
    broken = cl.make("ekf-local")
    object.__setattr__(broken, "fuse", lambda *_: None)
    with pytest.raises(cl.EstimatorError):
        cl.run({"arl": cl.make("arl", particles=20), "broken": broken}, stream)
    assert shown[0].startswith("<progress")
    assert shown[-1] == ""
