"""The smoother's path and covariances, and how estimators that saw later readings are kept apart."""

import numpy as np
import pytest
from oracles import dense_path, linear_team, measure_anchor_ranges, path_residuals

import cooploc as cl
from cooploc.analysis.claims.trial_table import collect
from cooploc.analysis.execution.run import execute, prepare
from cooploc.analysis.metrics.ranking import disqualifications
from cooploc.analysis.plot.style import name_of, summarize_for_figures
from cooploc.analysis.report import result_tables, sentences
from cooploc.analysis.report.result_tables import RESULTS
from cooploc.estimators.interface import Belief
from cooploc.scenarios import check_harness
from cooploc.scenarios.studies.study import Study


@pytest.mark.parametrize("relative", [True, False])
def test_where_all_is_linear_it_is_the_mean_and_covariance_of_the_whole_path_given_all_readings(relative):
    _, stream = linear_team(seed=32, trials=2, robots=3, ticks=7, relative=relative)
    found = cl.run({"hindsight": cl.Smoother()}, stream, isolate=False).traces["hindsight"]
    np.testing.assert_array_equal(cl.smoother(stream), found.x)
    for trial in range(2):
        mean, P = dense_path(stream, trial, 6, relative)
        np.testing.assert_allclose(found.x[trial], mean, atol=1e-9)
        dense = P.reshape(8, 3, 2, 8, 3, 2)
        for k, i in np.ndindex(7, 3):
            np.testing.assert_allclose(found.P[trial, k, i], dense[k + 1, i, :, k + 1, i], atol=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("anchors", ["rssi", "range"])
def test_elsewhere_no_path_beside_it_is_more_probable(rng, anchors):
    """By the density written down again."""

    def cost(trial, x):
        return (path_residuals(stream, trial, x) ** 2).sum()

    truth, stream = cl.simulate("packet-drop/drop=0.5", trials=3, seed=4, robots=3, ticks=10, prior_sigma=0.3)
    stream = measure_anchor_ranges(truth, stream) if anchors == "range" else stream
    found = cl.smoother(stream)
    for trial in range(3):
        least = cost(trial, found[trial])
        for scale in (1e-3, 1e-2, 0.1):
            beside = found[trial] + scale * rng.normal(size=(20, *found[trial].shape))
            assert min(cost(trial, x) for x in beside) > least


LABEL = "robots-1-3/n=2[ticks=12]"


class Exact:
    """Adds up odometry, all ticks at once."""

    api, offline, uses = 1, True, ("odometry",)

    def smooth(self, prior, world, rows, z, air):
        self.shapes = z.odometry.shape, z.anchor_rssi.shape, air.heard.shape, air.range.shape, rows.key.shape
        x = prior.x[:, None] + np.cumsum(z.odometry, 1)
        return Belief(x, np.broadcast_to(prior.P[:, None], (*x.shape, 2)))


@pytest.fixture(scope="module")
def stream_and_truth():
    return cl.simulate(LABEL, trials=6, seed=2)


def test_it_gets_all_ticks_of_the_channels_it_declares_and_its_beliefs_are_kept(stream_and_truth):
    _, stream = stream_and_truth
    one = Exact()
    traced = cl.run({"one": one, "dr": "dead-reckoning"}, stream, isolate=False).traces
    assert one.shapes == ((6, 12, 2, 2), (6, 12, 2, 0), (6, 12, 2, 2), (6, 12, 2, 2), (6, 2, 2))
    np.testing.assert_allclose(traced["one"].x, traced["dr"].x, atol=1e-12)
    assert traced["one"].offline


@pytest.mark.slow
def test_it_is_not_ranked_never_best_and_said_to_be_offline(stream_and_truth):
    truth, stream = stream_and_truth
    rows = cl.errors(truth, cl.run({"filter": "ekf-local", "hindsight": cl.Smoother()}, stream, isolate=False))
    table = cl.compare(rows, "filter", full=True)
    row = table.set_index("estimator").loc["hindsight"]
    assert disqualifications(row)[0] == "offline"
    ranks, letters = result_tables.rank_scenario(table, collect(rows))
    assert set(ranks) == {"filter"} > set(letters)
    (found,) = sentences.standings(table, collect(rows))
    assert "hindsight" not in (found.best, *found.equal, *found.tied)
    (remark,) = (column for column in RESULTS if column.head == "remark")
    assert "offline, not ranked" in remark.text({**row, "estimator": "hindsight"})
    assert [name_of(row) for row in summarize_for_figures(rows).to_dict("records")][1] == "hindsight (offline)"


@pytest.mark.slow
def test_it_passes_every_check_but_causality(short_streams, monkeypatch):
    monkeypatch.setattr(check_harness, "SCENARIOS", dict([*check_harness.SCENARIOS.items()][:1]))
    report = cl.check_estimator(cl.Smoother(), isolate=False)
    assert report.passed, report.table()
    skipped = {result.check for result in report.results if result.status == "skipped"}
    assert skipped == {"causality", "link-honesty"}  # it sees what is to come, and needs no packets


@pytest.mark.slow
def test_a_run_directory_keeps_that_it_is_offline(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.py").write_text("from cooploc import Smoother\n\n\nclass Mine(Smoother):\n    pass\n")
    study = Study(name="s", trials=6, scenarios=(LABEL,), estimators=("dead-reckoning", "mine.py:Mine"))
    execute(prepare(study), tmp_path / "run", check=False)
    offline = cl.load_run(tmp_path / "run").table.set_index("estimator")["offline"]
    assert offline.to_dict() == {"dead-reckoning": False, "mine.py:Mine": True}
