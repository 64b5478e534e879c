"""The sensors as pure functions of an array library give what they give, with numpy, and with JAX where it is."""

import numpy as np
import pytest

from cooploc.estimators.models import Bearing, LogDistance, Range, Sighting, innovation, wrap

SENSORS = (LogDistance(), Range(), Bearing(), Sighting())


@pytest.fixture(params=["numpy", "jax.numpy"])
def xp(request):
    library = pytest.importorskip(request.param)
    if library is not np:
        pytest.importorskip("jax").config.update("jax_enable_x64", True)
    return library


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("sensor", SENSORS, ids=lambda one: type(one).__name__)
def test_innovations_are_those_of_the_model(xp, sensor, d, rng):
    x, q = rng.normal(0, 3, (50, d)), rng.normal(0, 3, (50, 2))
    x[0, :2] = q[0] + 0.01  # inside the clamp of the logarithm
    z = rng.uniform(-4, 4, (50, len(sensor.R)))
    z[1] = np.nan
    expected = sensor.innovation(x, q, z)[0]
    found = np.asarray(innovation(xp, sensor, xp.asarray(x), xp.asarray(q), xp.asarray(z)))
    np.testing.assert_array_equal(np.isnan(found), np.isnan(expected))
    angles = slice(len(sensor.R) - isinstance(sensor, Bearing | Sighting), None)
    expected[..., angles] = found[..., angles] + wrap(expected - found)[..., angles]  # -pi is pi
    np.testing.assert_allclose(found, expected, atol=1e-10)
