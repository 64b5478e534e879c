"""`cooploc judge`: a stream, its truth, and trajectories that were computed elsewhere."""

from collections.abc import Mapping
from pathlib import Path

import pandas as pd

from cooploc.analysis.metrics.compare import compare
from cooploc.analysis.metrics.errors import errors
from cooploc.analysis.metrics.judging import judge
from cooploc.estimators import split
from cooploc.estimators.plugins.errors import BadInput
from cooploc.estimators.plugins.labels import parse
from cooploc.scenarios import BUILTIN, simulate
from cooploc.scenarios.runner.run import run
from cooploc.scenarios.runner.trace import Trace
from cooploc.scenarios.scenario import split_family
from cooploc.scenarios.stream import Stream, Truth


def judged(
    source: str,
    estimates: Mapping[str, Trace | str | Path] | str | Path,
    estimators: str | None,
    offline: bool,
    **how: object,
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """The rows of `judge`, those of our own `estimators` on the same stream first, and their table.

    Raises:
        BadInput: as `with_truth` and `judge`; or two have the same name.

    """
    truth, stream = with_truth(source, **how)  # type: ignore[arg-type]
    theirs = judge(truth, stream, estimates, offline=offline)
    frames = [theirs]
    if estimators is not None:
        mine = split(estimators)
        if same := set(mine) & set(theirs["estimator"]):
            raise BadInput(f"{same.pop()!r} is an estimator of ours and a folder of trajectories: rename the folder")
        frames.insert(0, errors(truth, run(mine, stream)))
    rows = pd.concat(frames, ignore_index=True)
    rows["certificate"] = rows["certificate"].fillna("")
    return rows, compare(rows, rows["estimator"].iloc[0], full=True)


def with_truth(
    source: str, trials: int | None = None, seed: int | None = None, data: str | Path | None = None
) -> tuple[Truth, Stream]:
    """The truth and the stream of a file that `Stream.save` wrote, or of a scenario.

    A file holds no truth: its scenario is simulated again, and must give the same readings.

    Raises:
        BadInput: it is neither, the file was made by another version, or its scenario is not a built-in one.

    """
    if not Path(source).is_file():
        return simulate(source, trials=1 if trials is None else trials, seed=seed or 0, data=data)
    if trials is not None or seed is not None:
        raise BadInput(f"{source} is a file, which says its trials and its seed itself: leave --trials and --seed out")
    stream = Stream.load(source)
    if split_family(parse(stream.scenario)[0])[0] not in BUILTIN:
        raise BadInput(
            f"{source} is of {stream.scenario!r}, which is not built in, and its code does not run by the name in a "
            "file: use cl.judge(truth, stream, ...)"
        )
    truth, again = simulate(stream.scenario, trials=stream.trial.tolist(), seed=stream.seed, data=data)
    if again.hashes != stream.hashes:
        raise BadInput(
            f"{source} does not hold the readings of {stream.scenario!r}, seed {stream.seed}, as they are made here: "
            "its truth is not known; save the stream again, or use cl.judge(truth, stream, ...)"
        )
    return truth, stream
