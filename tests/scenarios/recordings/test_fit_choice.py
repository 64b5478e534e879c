"""Least squares or Huber's fit: what is left out decides."""

import numpy as np
import pytest
from made_team import describe, write
from scipy.integrate import quad
from scipy.stats import norm

from cooploc.scenarios import resolve
from cooploc.scenarios.recordings.fit import crps, is_no_worse


@pytest.mark.parametrize(("e", "sigma"), [(0.0, 1.0), (0.7, 0.5), (-4.0, 2.0)])
def test_the_score_is_the_integral_that_defines_it(e, sigma):
    below, above = (quad(lambda t, c=c: (norm.cdf(t, 0, sigma) - c) ** 2, *ends)[0] for c, ends in
                    ((0, (-30, e)), (1, (e, 30))))  # fmt: skip
    assert crps(np.array([e]), sigma)[0] == pytest.approx(below + above, rel=1e-6)


@pytest.mark.parametrize(("worse", "taken"), [([0.9, 1.0, 0.8], True), ([1.3, 0.9, 0.8], True), ([1.1, 1.2], False)])
def test_a_tie_is_robust_and_what_is_shown_worse_is_not(worse, taken):
    assert is_no_worse(np.stack([np.ones(len(worse)), worse], -1)) == taken


def test_outliers_of_one_run_make_the_fit_of_another_robust_and_the_sentence_has_both_scores(tmp_path):
    for seed, name in enumerate(("one", "two", "three", "judged")):
        write(tmp_path / name, seed, 40.0)
    describe(tmp_path, ('on = "first part"\nseconds = 60.0', 'on = "other runs"'))
    head, *lines = (tmp_path / "one" / "uwb.csv").read_text().splitlines()
    cells = [line.rsplit(",", 1) for line in lines]
    late = [f"{start},{float(d) + 4.0 * (k % 5 == 0)}" for k, (start, d) in enumerate(cells)]
    (tmp_path / "one" / "uwb.csv").write_text("\n".join([head, *late]))
    judged = resolve("log/judged", tmp_path).model.judged_run
    assert judged.how.robust
    assert "3 runs, left out in turn" in judged.choice
    plain = resolve("log/judged", tmp_path, robust=False).model.judged_run
    assert judged.models.sensors["radio_range"].sigma < plain.models.sensors["radio_range"].sigma / 3
