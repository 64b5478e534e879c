"""Names, parameters, plug-ins and studies: what is known is found, what is not is refused with the remedy."""

from dataclasses import dataclass
from importlib.metadata import EntryPoint

import pytest

import cooploc as cl
from cooploc import estimators, scenarios
from cooploc.estimators import label_syntax, registry
from cooploc.estimators.arl import Arl


def test_parameters_are_written_the_same_everywhere():
    assert (
        cl.make("arl[particles=500,anchor_reading=rssi]")
        == cl.make("arl", particles=500, anchor_reading="rssi")
        == Arl(500, "rssi")
    )
    assert cl.make("rssi-pf") == Arl(anchor_reading="rssi")
    assert cl.make("ekf-local[gate=inf]").gate == float("inf")
    assert estimators.split_labels("arl[M=1,K=1],mrsl-rssi , ekf-local") == ["arl[M=1,K=1]", "mrsl-rssi", "ekf-local"]


@pytest.mark.parametrize(
    ("written", "said"),
    [
        ("arll", "there is no estimator 'arll'; did you mean 'arl'?"),
        ("mrsl", "there is no estimator 'mrsl'; did you mean 'mrsl-rssi' or 'mrsl-distance'?"),
        ("EKF-CI", "there is no estimator 'EKF-CI'; did you mean 'ekf-ci'?"),
        ("arl[partcles=3]", "estimator 'arl' has no parameter 'partcles'; did you mean 'particles'?"),
        ("arl[anchor_reading=gps]", "estimator 'arl', anchor_reading: "),
        ("arl[particles=1]", "particles is 1; it must be at least 2"),
        ("arl[particles]", "write name=value"),
        ("arl[particles=1", "write it like name[parameter=value,other=value]"),
        (3, "cannot read 3; write it like name[parameter=value,other=value]"),
        ("arl[uses=x]", "has no parameter 'uses'"),
        ("Mine=own.py:Mine", "'Mine' cannot be a name: write small letters, digits, hyphens, as in mine=own.py:Mine"),
        ("=own.py:Mine", "'' cannot be a name"),
        ("x=ekf-ci[gate=9]", "only what is in a Python file may have a name in front; leave x= out"),
        ("arl=own.py:Mine[K=1]", "an estimator is called 'arl' already: give own.py:Mine another name"),
    ],
)
def test_what_cannot_be_made_is_refused_with_the_remedy(written, said):
    with pytest.raises(cl.BadInput) as refusal:
        cl.make(written)
    assert said in str(refusal.value)
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize(
    ("label", "name", "shown"),
    [
        ("mine=a/own.py:Mine[gate=9]", "a/own.py:Mine", "mine[gate=9]"),
        ("own.py:Mine[gate=9]", "own.py:Mine", "own.py:Mine[gate=9]"),
        ("./a=b/own.py:Mine", "./a=b/own.py:Mine", "./a=b/own.py:Mine"),
        ("packet-drop/drop=0.7", "packet-drop/drop=0.7", "packet-drop/drop=0.7"),
        ("arl[model=own.py:Mine,K=1]", "arl", "arl[model=own.py:Mine,K=1]"),
    ],
)
def test_a_name_in_front_of_a_file_is_what_readers_see(label, name, shown):
    assert label_syntax.parse(label)[0] == name
    assert label_syntax.shorten_labels(f"best: {label}, arl") == f"best: {shown}, arl"


@dataclass(frozen=True)
class Plugged(Arl):
    """A plug-in."""


@pytest.fixture
def plugins(monkeypatch):
    def install(where, **points):
        found = [EntryPoint(name, value, where.REGISTRY.group) for name, value in points.items()]
        monkeypatch.setattr(registry, "entry_points", lambda group: [p for p in found if p.group == group])

    return install


def test_plugins_are_found_and_broken_ones_are_named(plugins):
    here = f"{__name__}:Plugged"
    plugins(estimators, mine=here, broken="no_such_module:X", arl=here)
    assert cl.make("mine[particles=7]") == Plugged(particles=7)
    assert "mine" in estimators.names()
    errors = estimators.plugin_errors()
    assert set(errors) == {"broken", "arl"}
    assert "no_such_module" in errors["broken"]
    assert "built-in" in errors["arl"]
    assert type(cl.make("arl")) is Arl
    with pytest.raises(cl.BadInput, match="cannot be imported"):
        cl.make("broken")


FAMILY = scenarios.Family("mine", scenarios.PAPER, {"robots": 2})


def test_scenario_plugins_are_found_and_broken_ones_are_named(plugins):
    plugins(scenarios, mine=f"{__name__}:FAMILY", broken=f"{__name__}:Plugged", nlos_="no.such:X")
    assert cl.simulate("mine")[1].robots == 2
    assert set(scenarios.plugin_errors()) == {"broken", "nlos_"}


def test_two_plugins_of_one_name_are_both_named(monkeypatch):
    points = [EntryPoint("mine", value, estimators.REGISTRY.group) for value in ("here:Mine", "elsewhere:Other")]
    monkeypatch.setattr(registry, "entry_points", lambda group: [*points, points[0]])
    said = "2 plug-ins are called estimator 'mine': here:Mine of an unknown package and elsewhere:Other of"
    assert estimators.plugin_errors()["mine"].startswith(said)
    with pytest.raises(cl.BadInput, match="uninstall all but one"):
        cl.make("mine")
