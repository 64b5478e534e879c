"""What the Kalman filters' parameters are, how they are explained, and which worlds they refuse."""

import pydoc
from dataclasses import fields

import pytest

from cooploc.estimators import BUILTIN, make
from cooploc.estimators.kalman.settings import Settings, TeamSettings
from cooploc.scenarios import simulate

FILTERS = [name for name in BUILTIN if name.startswith(("ekf-", "ukf-"))]


@pytest.mark.parametrize("name", FILTERS)
def test_help_explains_every_parameter(name):
    shown = pydoc.render_doc(make(name), renderer=pydoc.plaintext)
    for field in fields(make(name)):
        assert f" {field.name}: " in shown.partition("Parameters:")[2].partition("Method resolution order")[0]


@pytest.mark.parametrize("name", FILTERS)
def test_every_filter_shares_the_settings(name):
    made = make(name, anchor_reading="rssi", gate=4.0, engine="filterpy")
    assert isinstance(made, Settings)
    assert isinstance(made, TeamSettings) == (name != "ekf-local")
    assert (made.anchor_reading, made.gate, made.engine) == ("rssi", 4.0, "filterpy")


@pytest.mark.parametrize("name", FILTERS)
def test_a_direction_of_arrival_without_four_corners_is_refused(name):
    _, stream = simulate("anchors/a=5", ticks=2)
    with pytest.raises(ValueError, match="needs four corner anchors"):
        make(name).require_corners(stream.world)
    make(name, anchor_reading="rssi").require_corners(stream.world)


def test_channels_are_what_is_read():
    assert make("ekf-local").uses == ("odometry", "anchor_rssi|landmark")
    assert make("ekf-naive", reading="rssi").uses == ("odometry", "anchor_rssi|landmark", "sighting|radio_rssi")
    assert make("ekf-ci", form="ls").uses == ("odometry", "anchor_rssi|landmark", "sighting")
