"""Streams with their truth, to learn from: of seeds that no result is reported of."""

from collections.abc import Mapping, Sequence
from typing import Any

from cooploc.analysis.tuning.training import derived_seed
from cooploc.estimators.plugins.errors import BadInput
from cooploc.estimators.plugins.labels import parse
from cooploc.scenarios import family, simulate
from cooploc.scenarios.scenario import split_family
from cooploc.scenarios.stream import Stream, Truth


def training(
    label: str,
    trials: int | Sequence[int] = 100,
    *,
    seed: int = 0,
    assumed: Mapping[str, Any] | None = None,
    **overrides: Any,
) -> tuple[Truth, Stream]:
    """The truth and the stream of a scenario, to learn from: models, networks, tables.

    The seed is a hash of `seed`, as in `cl.tune`: it does not lead back, and no study is run under it. What an
    estimator learned belongs into a file beside it that its class names in `artifacts`; while the estimator runs, this
    function is refused, as is every other way to the truth.

    Args:
        label: a simulated scenario, such as "nlos".
        trials: how many, or their numbers.
        seed: of the experiment; the streams of two seeds have nothing in common.
        assumed, overrides: as of `simulate`.

    Raises:
        BadInput: it is a recording, of which other parts would be judged; or as `simulate`.

    """
    if family(split_family(parse(label)[0])[0]).recorded:
        raise BadInput(
            f"{label!r} is a recording, which is the same under every seed: learn from another run, by cl.simulate, "
            "and judge on this one"
        )
    return simulate(label, trials=trials, seed=derived_seed(seed, "training"), assumed=assumed, **overrides)
