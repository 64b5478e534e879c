"""Accidents and cheap deceptions that small streams do not show: each is caught by the check that is meant for it."""

import shutil

import catching
import cheats
import numpy as np
import pytest
from counting import FILE

from cooploc.analysis.execution.world_players import players
from cooploc.scenarios.conformance.own_worlds import OWN, OwnWorld
from cooploc.scenarios.processes.workers import end_all
from cooploc.scenarios.runner.trace import trace

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module", autouse=True)
def _fresh_process():
    yield
    end_all()
    for left in FILE.parent.glob(f"{FILE.name}*"):
        shutil.rmtree(left) if left.is_dir() else left.unlink()


@pytest.mark.parametrize("name", catching.GALLERY)
def test_a_cheat_is_caught_by_the_check_that_is_meant_for_it(name):
    found = catching.caught(name)
    assert found.caught, found.said


def test_what_the_cheats_are_made_of_is_not_accused():
    own = OwnWorld(catching.world()[1], players(cheats.label("Counts"), 60.0), np.random.default_rng(3))
    for check in OWN.values():
        check(own)
    there = catching._there("Counts")
    assert not there.caught, there.said


@pytest.mark.parametrize("name", ["TruthByCollector", "TruthInFrames", "SeedInFrames"])
def test_without_the_wall_the_truth_or_its_seed_would_be_found(name):
    truth, stream = catching.world()
    found, honest = (trace(one, cheats.cheat(one)(), stream).x for one in (name, "Counts"))
    assert not np.array_equal(found, honest), truth


def test_the_gallery_has_at_least_thirty_five():
    assert len(catching.GALLERY) >= 35
    assert all(cheats.cheat(name) for name in catching.GALLERY)
