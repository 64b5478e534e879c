"""The parts of a team's fit, on residuals whose model is known; and what is left out decides how it is fitted."""

import re

import numpy as np
import pytest
from made_team import describe, write
from scipy.integrate import quad
from scipy.stats import norm, t
from statsmodels.robust.norms import HuberT
from statsmodels.robust.robust_linear_model import RLM
from statsmodels.robust.scale import HuberScale

from cooploc.estimators.robust import DEGREES, penalty
from cooploc.scenarios import resolve
from cooploc.scenarios.recordings import fit
from cooploc.scenarios.recordings.fit import K, LinkResiduals, Residuals, huber
from cooploc.scenarios.recordings.fit_choice import SPREADS, HeldOut, choose_loss, crps, is_no_worse


def residuals(rng, links=3, ticks=2000, burst=None):
    """Links with a reading in every tick, or in bursts with as many ticks between them."""
    tick = np.concatenate([np.arange(ticks) for _ in range(links)])
    link = np.repeat(np.arange(links), ticks)
    kept = np.ones(len(tick), bool) if burst is None else (tick // burst) % 2 == 0
    distance = rng.uniform(0.5, 6.0, len(tick))
    return Residuals(link[kept], tick[kept], distance[kept], np.zeros((kept.sum(), 2)))


def remembered(rng, r, correlation):
    """A first-order process of unit variance for each link, one value a tick."""
    noise = np.zeros(len(r.tick))
    for k, white in enumerate(rng.normal(size=len(noise))):
        same = k > 0 and r.link[k] == r.link[k - 1] and r.tick[k] == r.tick[k - 1] + 1
        noise[k] = correlation * noise[k - 1] + np.sqrt(1 - correlation**2) * white if same else white
    return noise


@pytest.mark.parametrize("robust", [False, True])
def test_bias_by_pair_and_sigma_are_found(robust):
    rng = np.random.default_rng(0)
    r = residuals(rng)
    outliers = 3.0 * (rng.random(len(r.link)) < 0.1 * robust)
    z = r.distance + np.array([0.1, 0.3, -0.2])[r.link] + 0.05 * rng.normal(size=len(r.link)) + outliers
    bias, _, sigma, _ = fit.fit_range(r._replace(z=z[:, None]), None, robust)
    np.testing.assert_allclose([bias[k] for k in range(3)], [0.1, 0.3, -0.2], atol=0.02)
    assert sigma == pytest.approx(0.05, rel=0.35 if robust else 0.05)
    assert fit.fit_range(r._replace(z=z[:, None]), 0.1, robust)[:2] == ({}, 0.1)


def test_a_pair_with_few_readings_gets_the_bias_of_all():
    rng = np.random.default_rng(1)
    r = residuals(rng)
    kept = (r.link < 2) | (r.tick < 5)
    few = Residuals(*(a[kept] for a in r[:4]))
    bias, common, *_ = fit.fit_range(few._replace(z=few.distance[:, None] + 0.2), None, True)
    assert set(bias) == {0, 1}
    assert common == pytest.approx(0.2)


def test_path_loss_is_found_and_what_is_stated_stays():
    rng = np.random.default_rng(2)
    r = residuals(rng)
    r = r._replace(z=(-42 - 10 * 2.2 * np.log10(r.distance) + 3 * rng.normal(size=len(r.link)))[:, None])
    np.testing.assert_allclose(fit.fit_path_loss(r, None, None, True)[:3], [-42, 2.2, 3], rtol=0.03)
    assert fit.fit_path_loss(r, -40.0, None, True)[0] == -40
    assert fit.fit_path_loss(r, None, 2.0, True)[1] == 2


@pytest.mark.parametrize(("correlation", "burst"), [(0.0, None), (0.6, None), (0.9, 8), (0.99, 5)])
def test_the_mean_of_a_burst_has_the_spread_that_inflated_sigma_promises(correlation, burst):
    rng = np.random.default_rng(3)
    r = residuals(rng, links=6, ticks=4000, burst=burst)
    noise = remembered(rng, r, correlation)
    found = fit.memory(r, noise)
    assert found.lag1 == pytest.approx(correlation, abs=0.05)
    m = burst or 100
    assert found.burst == (burst or 4000)
    means = noise.reshape(-1, m).mean(1)
    assert means.std() * np.sqrt(m) == pytest.approx(fit.inflation(found), rel=0.15)


@pytest.mark.parametrize("outliers", [0.0, 0.1, 0.3])
def test_it_is_that_of_statsmodels(outliers):
    rng = np.random.default_rng(1)
    X = np.stack([np.ones(600), rng.uniform(-3, 3, 600)], -1)
    y = X @ [2.0, -0.7] + 0.3 * rng.normal(size=600) + 9.0 * (rng.random(600) < outliers)
    theirs = RLM(y, X, M=HuberT(K)).fit(scale_est=HuberScale(K, tol=1e-10, maxiter=500), tol=1e-10, maxiter=500)
    beta, sigma = huber(X, y)
    np.testing.assert_allclose(beta, theirs.params, rtol=1e-5)
    assert sigma == pytest.approx(theirs.scale, rel=1e-4)


def test_what_fits_exactly_has_no_noise():
    x = np.arange(1.0, 20.0)
    beta, sigma = huber(x[:, None], 3 * x)
    assert beta[0] == pytest.approx(3)
    assert sigma < 1e-9
    assert huber(np.empty((5, 0)), np.zeros(5))[1] == 0


@pytest.mark.parametrize(("e", "sigma"), [(0.0, 1.0), (0.7, 0.5), (-4.0, 2.0)])
def test_the_score_is_the_integral_that_defines_it(e, sigma):
    below, above = (quad(lambda t, c=c: (norm.cdf(t, 0, sigma) - c) ** 2, *ends)[0] for c, ends in
                    ((0, (-30, e)), (1, (e, 30))))  # fmt: skip
    assert crps(np.array([e]), sigma)[0] == pytest.approx(below + above, rel=1e-6)


@pytest.mark.parametrize(("worse", "taken"), [([0.9, 1.0, 0.8], True), ([1.3, 0.9, 0.8], True), ([1.1, 1.2], False)])
def test_a_tie_is_robust_and_what_is_shown_worse_is_not(worse, taken):
    assert is_no_worse(np.stack([np.ones(len(worse)), worse], -1)) == taken


@pytest.mark.parametrize("loss", SPREADS)
def test_the_density_of_a_loss_integrates_to_one(loss):
    assert quad(lambda z: np.exp(-penalty(loss, np.array(z**2), 1) / 2 - SPREADS[loss]), -80, 80)[0] == pytest.approx(
        1, abs=1e-4
    )


@pytest.mark.parametrize(("density", "expected"), [(norm, "none"), (t(2), "student")])
def test_the_loss_is_that_of_the_density_that_predicts_best_and_its_gain_is_in_log_likelihood(density, expected):
    parts = [density.rvs(size=300, random_state=k) for k in range(5)]
    links = [LinkResiduals("range", "m", "red - blue", False, 1 + 0 * z, 0.2 * z, 0.2) for z in parts]
    loss, why = choose_loss([HeldOut(None, None, None, [link]) for link in links], "runs")
    gain = np.mean([(t(DEGREES).logpdf(z) - norm.logpdf(z)).mean() for z in parts])
    assert loss == expected
    assert expected == "none" or f"log-likelihood {gain:+.2g} a reading" in why


def with_late_signals(path):
    head, *lines = path.read_text().splitlines()
    cells = [line.rsplit(",", 1) for line in lines]
    late = [f"{start},{float(d) + 4.0 * (k % 5 == 0)}" for k, (start, d) in enumerate(cells)]
    path.write_text("\n".join([head, *late]))


@pytest.mark.slow
def test_outliers_make_the_fit_and_the_loss_robust_and_the_sentence_has_the_scores(tmp_path):
    for seed, name in enumerate(("one", "two", "three", "judged")):
        write(tmp_path / name, seed, 40.0)
    describe(tmp_path, ('on = "first part"\nseconds = 60.0', 'on = "other runs"'))
    assert resolve("log/judged", tmp_path).model.judged_run.loss == "none"
    with_late_signals(tmp_path / "one" / "uwb.csv")
    judged = resolve("log/judged", tmp_path).model.judged_run
    assert judged.how.robust
    scores = re.search(r"with Huber's loss \(CRPS of left-out runs ([\d.]+), ([\d.]+) by least", judged.choice)
    assert float(scores[1]) < float(scores[2])
    plain = resolve("log/judged", tmp_path, robust=False).model.judged_run
    assert judged.models.sensors["radio_range"].sigma < plain.models.sensors["radio_range"].sigma / 3
    for name in ("two", "three"):
        with_late_signals(tmp_path / name / "uwb.csv")
    heavy = resolve("log/judged", tmp_path).model
    assert heavy.judged_run.loss == heavy.world().sensors["radio_range"].loss != "none"
    assert f"loss={heavy.judged_run.loss}" in heavy.judged_run.choice
    describe(tmp_path, ('on = "first part"\nseconds = 60.0', 'on = "other runs"\nloss = "none"'))  # what is said counts
    assert resolve("log/judged", tmp_path).model.judged_run.loss == "none"
    assert resolve("log/judged", tmp_path, loss="huber").model.judged_run.loss == "huber"
