"""Particles as clusters, against the same in plain numpy."""

import numpy as np
import pytest

from cooploc.estimators.mixtures import clusters


def reference(x, w, K):
    """Clusters (share, mean, covariance) of one robot's particles (N, 2), by lists of members."""
    groups = [np.arange(len(x))]

    def described(members):
        share = w[members].sum()
        return share, np.average(x[members], 0, w[members]), np.cov(x[members].T, aweights=w[members], ddof=0)

    while len(groups) < K:
        variances = np.array([np.diag(described(members)[2]) for members in groups])
        widest, axis = np.unravel_index(variances.argmax(), variances.shape)
        members = groups[widest]
        above = x[members, axis] > described(members)[1][axis]
        groups[widest] = members[~above]
        groups.append(members[above])
    return [described(members) for members in groups]


@pytest.mark.parametrize("K", [1, 2, 5, 8])
def test_clusters_are_those_of_plain_numpy(rng, K):
    x, w = rng.normal(size=(3, 60, 2)) * [1.0, 0.5], rng.uniform(size=(3, 60))
    w /= w.sum(-1, keepdims=True)
    got = clusters(x, w, K)
    for r in range(3):
        for k, (share, mean, P) in enumerate(reference(x[r], w[r], K)):
            np.testing.assert_allclose(got.w[r, k], share)
            np.testing.assert_allclose(got.x[r, k], mean)
            np.testing.assert_allclose(got.P[r, k], P, atol=1e-12)
