"""The direction with its local variance, and the gradient, against Monte Carlo, finite differences and filterpy."""

import numpy as np
import pytest
from oracles import slope

from cooploc.estimators.models import (
    NOWHERE,
    GradientDoa,
    GradientReading,
    LogDistance,
    WeightedDoa,
    fixed_readings,
    gradient_doa,
)
from cooploc.scenarios import simulate

SQUARE = GradientDoa(LogDistance(-40.0, 3.0, 5**0.5), (0.0, 0.0), (6.0, 6.0))
OBLONG = GradientDoa(LogDistance(-40.0, 2.0, 3.0), (10.0, -4.0), (8.0, 3.0))
# As shares of the sides: near the centre, half way, beside a wall, beside a corner.
PLACES = [(0.52, 0.49), (0.3, 0.65), (0.5, 0.98), (0.02, 0.4), (0.95, 0.93)]
DRAWS = 200_000
arenas = pytest.mark.parametrize("doa", [SQUARE, OBLONG], ids=["square", "oblong"])
at_places = pytest.mark.parametrize("share", PLACES)


def place(doa, share):
    return np.array(doa.corner) + np.array(doa.sides) * share


def measured(doa, x, seed=1):
    """Gradients (DRAWS, 2) of the four corner readings of a robot at x."""
    rssi = doa.rssi.level(x, doa.anchors) + doa.rssi.sigma * np.random.default_rng(seed).normal(size=(DRAWS, 4))
    return doa.gradient(rssi)


@arenas
@at_places
def test_the_weighted_direction_has_mean_0_and_the_variance_of_von_mises_angles(doa, share):
    """E[k theta^2] over k = |u||m|, theta von Mises of concentration k: also where the gradient vanishes."""
    x = place(doa, share)
    z = measured(doa, x)
    y, _, _ = WeightedDoa(doa).innovation(x, NOWHERE, z)
    u, m = z * doa.sides / doa.rssi.sigma, doa.expect(x) * doa.sides / doa.rssi.sigma
    k = np.hypot(*u.T) * np.hypot(*m)
    grid, theta = np.linspace(0, k.max(), 500), np.linspace(-np.pi, np.pi, 1001)[:-1]
    density = np.exp(grid[:, None] * (np.cos(theta) - 1))
    variance = (density * theta**2).sum(1) / density.sum(1)
    assert abs(y.mean()) < 4 * y.std() / np.sqrt(DRAWS)
    assert (y**2).mean() == pytest.approx(np.interp(k, grid, grid * variance).mean(), abs=4 * (y**2).std() / DRAWS**0.5)


@arenas
@at_places
def test_a_gradient_has_the_noise_and_the_mean_that_it_states(doa, share):
    x = place(doa, share)
    reading = GradientReading(doa)
    y, _, _ = reading.innovation(x, NOWHERE, measured(doa, x))
    np.testing.assert_allclose(np.cov(y.T), reading.R, atol=0.01 * reading.R.max())
    assert (abs(y.mean(0)) < 4 * np.sqrt(np.diag(reading.R) / DRAWS)).all()


@arenas
@at_places
@pytest.mark.parametrize("d", [2, 3])
def test_the_slopes_are_those_of_the_expected_gradient_and_direction(doa, share, d):
    """A direction's slope is that at a fixed weight, which is 1 / its standard deviation."""
    x = np.append(place(doa, share), [0.7] * (d - 2))
    z = measured(doa, x)[0]
    _, H, Hq = GradientReading(doa).innovation(x, NOWHERE, z)
    np.testing.assert_allclose(H, slope(doa.expect, x), atol=1e-6)
    assert not Hq.any()
    sensor = WeightedDoa(doa)
    _, H, Hq = sensor.innovation(x, NOWHERE, z)
    _, variance = sensor.at(x, z)

    def direction(at):
        m = doa.expect(at) * doa.sides
        return np.arctan2(m[..., 1:], m[..., :1])

    np.testing.assert_allclose(H * np.sqrt(variance), slope(direction, x), rtol=1e-5, atol=1e-7)
    assert not Hq.any()


def test_what_is_made_of_the_anchors_is_what_was_asked_for():
    _, stream = simulate("robots-1-3/n=1", trials=2, ticks=1)
    z = stream.senses._replace(**{name: getattr(stream.senses, name)[:, 0, 0] for name in stream.senses._fields[:-1]})
    made = {r: list(fixed_readings(stream.world, z, r)) for r in ("doa", "doa-constant", "gradient", "rssi")}
    kinds = [[type(sensor) for sensor, _, _ in found] for found in made.values()]
    assert kinds == [[WeightedDoa], [GradientDoa], [GradientReading], [LogDistance] * 4]
    np.testing.assert_array_equal(made["gradient"][0][2], gradient_doa(stream.world).gradient(z.anchor_rssi))
    nothing = z._replace(anchor_rssi=np.full_like(z.anchor_rssi, np.nan))
    assert not list(fixed_readings(stream.world, z, "none"))
    assert not [reading for r in made for reading in fixed_readings(stream.world, nothing, r)]
