"""What the Kalman filters' parameters are, how they are explained, and which worlds they refuse."""

import pydoc
from dataclasses import fields

import numpy as np
import pytest

from cooploc.estimators import BUILTIN, make
from cooploc.estimators.kalman_parameters import assumed_world
from cooploc.scenarios import simulate
from cooploc.scenarios.runner.run import run

FILTERS = [name for name in BUILTIN if name.startswith(("ekf-", "ukf-"))]


@pytest.mark.parametrize("name", FILTERS)
def test_help_explains_every_parameter(name):
    shown = pydoc.render_doc(make(name), renderer=pydoc.plaintext)
    for field in fields(make(name)):
        assert f" {field.name}: " in shown.partition("Parameters:")[2].partition("Method resolution order")[0]


@pytest.mark.parametrize("name", FILTERS)
def test_a_direction_of_arrival_without_four_corners_is_refused(name):
    _, stream = simulate("anchors/a=5", ticks=2)
    with pytest.raises(ValueError, match="needs four corner anchors"):
        assumed_world(make(name), stream.world)
    for reading in ("rssi", "none"):
        assumed_world(make(name, anchor_reading=reading), stream.world)


@pytest.mark.parametrize("name", ["ekf-local", "ekf-joint", "ekf-ci", "ukf-joint", "map-joint"])
@pytest.mark.parametrize("scenario", ["robots-1-3/n=2", "camera/n=2"])
def test_without_anchors_and_teammates_every_filter_is_dead_reckoning(name, scenario):
    _, stream = simulate(scenario, trials=2, ticks=10, drop=1.0)
    alone = stream.with_arrays({"senses.sighting": np.full_like(stream.senses.sighting, np.nan)})
    made = {"none": make(name, anchor_reading="none"), "dead": make("dead-reckoning")}
    traces = run(made, alone).traces
    np.testing.assert_allclose(traces["none"].x, traces["dead"].x, atol=1e-9 if name != "ukf-joint" else 1e-3)
    np.testing.assert_allclose(traces["none"].P, traces["dead"].P, atol=1e-9 if name != "ukf-joint" else 1e-3)
