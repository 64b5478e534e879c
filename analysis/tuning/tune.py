"""Tune every estimator of a study alike, then run it as shipped and as tuned on the study's own streams.

The streams that estimators are tuned on never meet those that results are reported of. Simulated ones come from a seed
of their own, a hash of the study's seed that does not lead back to it. A recording has no seed: the study says in
`training` on which other recordings, or other parts of one, it is tuned, and a part that overlaps with what is judged
is refused.

The directory of a tuning holds two run directories, `training` of the search and `fresh` of the comparison; the study
with the tuned configurations; and the tables. The same call goes on with what is there: a search that is repeated gets
the same scores, so that it makes the same proposals and computes nothing twice.
"""

import hashlib
import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from importlib.metadata import version
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from cooploc.analysis.execution.run import RunProgress, Silent, execute, prepare
from cooploc.analysis.execution.run_directory import read_run, replace_file
from cooploc.analysis.formats import join_words
from cooploc.analysis.metrics import statistics
from cooploc.analysis.metrics.compare import compare
from cooploc.analysis.metrics.errors import CELL, drop_failed, weighted_means
from cooploc.analysis.metrics.statistics import FIXED
from cooploc.analysis.tuning.search import Finish, Item, Lane, Pair, race, require_objective, space_of, trial_scores
from cooploc.estimators import configure
from cooploc.estimators.errors import BadInput, count_of
from cooploc.estimators.label_syntax import parse
from cooploc.scenarios import family, resolve, simulate
from cooploc.scenarios.recordings.inspect.draft_toml import toml
from cooploc.scenarios.runner.run import list_table
from cooploc.scenarios.scenario import ResolvedScenario, split_family
from cooploc.scenarios.stream import Stream, Truth
from cooploc.scenarios.studies.study import Block, ResolvedCell, ResolvedStudy, Study

MOST_BUDGET = 1_000_000
STUDY_FILE, RECORD_FILE = "tuned.toml", "tuning.json"
HISTORY_FILE, TABLE_FILE = "history.csv", "shipped-and-tuned.csv"
VALUE = "value: "  # before a parameter's name: columns of `history`
SHOWN = ("rmse", "nll", "anees", "consistency", "coverage95", "failed")
SIDES = ("shipped", "tuned")
SIGNIFICANCE = 0.05


@dataclass(frozen=True, eq=False, repr=False)
class Tuned:
    """The result of a tuning, and the directory that holds it."""

    folder: Path
    history: pd.DataFrame  # one row per configuration that was tried, as of `history`
    table: pd.DataFrame  # one row per scenario and estimator, as shipped and tuned, as of `gains`
    rows: pd.DataFrame  # as `cl.errors`, of the fresh streams
    tuned: dict[str, str]  # the tuned label of every estimator
    record: dict[str, Any]  # budget, seeds, hashes of the streams that tuning used

    @property
    def study(self) -> Path:
        """The study file with the tuned configurations, for `cooploc run`."""
        return self.folder / STUDY_FILE

    def order(self, by: str = "rmse") -> pd.DataFrame:
        """Compare every pair of estimators as shipped and as tuned, as of `order`."""
        return order(self.rows, self.tuned, by)

    def __repr__(self) -> str:
        return f"Tuned({str(self.folder)!r}, {count_of(len(self.tuned), 'estimator')}, budget {self.record['budget']})"

    def _repr_html_(self) -> str:
        return list_table(("estimator", "tuned"), repr(self), self.tuned.items())


def tune(
    study: Study,
    out: Path,
    budget: int,
    objective: str = "nll",
    *,
    data: Path | None = None,
    jobs: int = 1,
    check: bool = True,
    isolate: bool = True,
    progress: RunProgress | None = None,
) -> Tuned:
    """Tune, compare on fresh streams, and keep everything in `out`; what is there already is not computed again."""
    if not 1 <= budget <= MOST_BUDGET:
        raise BadInput(f"budget is {budget}; it must be at least 1 trial, and at most {MOST_BUDGET}")
    require_objective(objective)
    if out.exists() and not (out / "training").is_dir() and (not out.is_dir() or any(out.iterdir())):
        raise BadInput(f"{out} exists and is not the directory of a tuning; name another by --out, in Python out=")
    watcher, seed = progress or Silent(), derived_seed(study.seed, "training")
    asked = prepare(study.model_copy(update={"seed": seed}), data, isolate=isolate, say=watcher.say)
    own = lanes(asked.cells, study.training, data)
    competitors = [
        (space_of(one.label, isolate), mine)
        for one in asked.estimators
        if (mine := [own[c.scenario.label] for c in asked.cells if one in c.estimators and c.scenario.label in own])
    ]
    if not competitors:
        raise BadInput(f"study {study.name!r} has no scenario that estimators may be tuned on: see its training")
    for space, mine in competitors:
        if budget < len(mine):
            raise BadInput(
                f"the budget is {budget} trials, and {space.shipped.label!r} is tuned on {len(mine)} scenarios: give "
                f"at least --budget {len(mine)}"
            )
    if fixed := [space.shipped.label for space, _ in competitors if not space.parameters]:
        some = f"{join_words(fixed)} {'declares' if len(fixed) == 1 else 'declare'} no parameters to tune (cl.tunable)"
        if len(fixed) == len(competitors):
            raise BadInput(f"{some}: name an estimator that does, or declare some")
        watcher.say(f"{some}: as shipped")
    (out / RECORD_FILE).unlink(missing_ok=True)
    watcher.begin(budget * len(competitors), 0)
    scenarios = {one.label: one for lane in own.values() for one in lane.scenarios}
    options: dict[str, Any] = {"jobs": jobs, "isolate": isolate}
    evaluations = Evaluations(asked, scenarios, out / "training", objective, watcher, options)
    sampler_seed = derived_seed(study.seed, "sampler")
    finishes = [race(space, mine, budget, sampler_seed, evaluations.compute) for space, mine in competitors]
    tuned = {one.label: one.label for one in asked.estimators} | {one.shipped: one.best.label for one in finishes}
    _write(out / STUDY_FILE, as_toml(tuned_study(study, tuned, seed, both=False)))
    both = prepare(tuned_study(study, tuned, seed, both=True), data, isolate=isolate)
    rows = execute(both, out / "fresh", check=check, progress=watcher, **options)
    record = {
        "study": study.model_dump(mode="json"),
        "budget": budget,
        "objective": objective,
        "optuna": version("optuna"),
        "seed": study.seed,
        "training_seed": seed,
        "spent": {one.shipped: one.spent for one in finishes},
        "spaces": {
            one.shipped: {name: each._asdict() for name, each in one.space.parameters.items()} for one in finishes
        },
        "streams": {f"{item.scenario}, trial {item.trial}": digest for item, digest in evaluations.streams.items()},
        "tuned": tuned,
    }
    found = Tuned(out, history(finishes), gains(rows, finishes, objective), rows, tuned, record)
    _write(out / HISTORY_FILE, found.history.to_csv(index=False, lineterminator="\n"))
    _write(out / TABLE_FILE, found.table.to_csv(index=False, lineterminator="\n"))
    _write(out / RECORD_FILE, json.dumps(record, indent=1) + "\n")  # last, as it says that all is there
    return found


def load_tuned(folder: str | Path) -> Tuned:
    """Load what a finished tuning left in its directory.

    Raises:
        BadInput: it is not the directory of a tuning, one that has not finished, or one whose files are damaged.

    """
    where = Path(folder)
    if not (where / RECORD_FILE).is_file():
        raise BadInput(
            f"{folder} holds no finished tuning: name the directory that cooploc tune wrote, or run it again"
        )
    try:
        record = json.loads((where / RECORD_FILE).read_text(encoding="utf-8"))
        tried, table = (pd.read_csv(where / name) for name in (HISTORY_FILE, TABLE_FILE))
        return Tuned(where, tried, table, read_run(where / "fresh").rows, record["tuned"], record)
    except (OSError, ValueError, LookupError, TypeError) as e:
        raise BadInput(f"{folder} is damaged ({e}); the cooploc tune that wrote it writes it again") from None


def _write(file: Path, text: str) -> None:
    replace_file(file, lambda temporary: temporary.write_bytes(text.encode()))


@dataclass
class Evaluations:
    """Scores of configurations on training trials, each computed once and kept in a run directory."""

    training: ResolvedStudy  # its study has the training seed; its cells are replaced by what is asked for
    scenarios: Mapping[str, ResolvedScenario]
    folder: Path
    objective: str
    watcher: RunProgress
    options: Mapping[str, Any]  # of `execute`
    scores: dict[Pair, float] = field(default_factory=dict)
    streams: dict[Item, str] = field(default_factory=dict)  # hashes of what tuning has seen

    def compute(self, pairs: Iterable[Pair]) -> dict[Pair, float]:
        """Return the scores of these configurations, by their labels, on these trials."""
        pairs = list(pairs)
        upto: dict[str, dict[str, int]] = {}  # of each scenario as many trials of each configuration as it needs
        for label, item in pairs:
            trials = upto.setdefault(item.scenario, {})
            trials[label] = max(trials.get(label, 0), item.trial + 1)
        cells = tuple(
            ResolvedCell("training", self.scenarios[label], trials, tuple(map(configure, trials)), next(iter(trials)))
            for label, trials in upto.items()
        )
        rows = execute(self.training._replace(cells=cells), self.folder, check=False, keep=True, **self.options)
        for cell, part in rows.groupby(CELL, sort=False):
            scenario, label = map(str, cell)
            scores = trial_scores(part, self.objective).items()
            found = {(label, Item(scenario, int(str(trial)))): float(score) for trial, score in scores}
            self.watcher.advance(f"{scenario} · {label}", len(found.keys() - self.scores.keys()), 0)
            self.scores |= found
        for row in rows.dropna(subset="stream").drop_duplicates(["scenario", "trial"]).itertuples():
            self.streams[Item(str(row.scenario), int(str(row.trial)))] = str(row.stream)
        return {pair: self.scores[pair] for pair in pairs}


# ---- the split of streams


def derived_seed(seed: int, purpose: str) -> int:
    """Return a seed below 2^63 that does not lead back to `seed`."""
    text = f"{seed}/{purpose}/0".encode()
    return int.from_bytes(hashlib.blake2b(text, digest_size=8, person=b"cooploc tuning").digest(), "little") >> 1


def training(
    label: str,
    trials: int | Sequence[int] = 100,
    *,
    seed: int = 0,
    assumed: Mapping[str, Any] | None = None,
    **overrides: Any,
) -> tuple[Truth, Stream]:
    """Simulate the truth and the stream of a scenario to learn from: models, networks, tables.

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


def lanes(cells: Iterable[ResolvedCell], training: dict[str, tuple[str, ...]], data: Path | None) -> dict[str, Lane]:
    """Return the lane of every judged scenario; one whose `training` is empty has none, and is only judged."""
    judged = {cell.scenario.label: cell.scenario for cell in cells}
    if unknown := [label for label in training if label not in judged]:
        raise BadInput(f"training names {unknown[0]!r}, which is not a scenario of the study; leave it out")
    found = {}
    for label, scenario in judged.items():
        if scenario.is_recording and label not in training:
            raise BadInput(
                f"scenario {label!r} is a recording, and tuning on the run that is judged is refused: say in the "
                f'study on which other it is tuned, training = {{ "{label}" = ["..."] }}, or [] for none'
            )
        own = tuple(resolve(one, data) for one in training[label]) if label in training else (scenario,)
        if own:
            found[label] = Lane(label, own)
    reported = [(one.label, stream) for one in judged.values() if one.is_recording for stream in _recordings(one)]
    trained = {one.label: one for lane in found.values() for one in lane.scenarios if one.is_recording and reported}
    for one in trained.values():
        for stream in _recordings(one):
            for label, other in reported:
                if overlap(stream, other):
                    raise BadInput(
                        f"training on {one.label!r} would use readings of {label!r}, which is judged: choose another "
                        "run, or parts of it that do not overlap"
                    )
    return found


def _recordings(scenario: ResolvedScenario) -> list[Stream]:
    """Return its trials, each a stream."""
    return [scenario.simulate([trial], 0)[1] for trial in range(scenario.trials(1))]


def overlap(a: Stream, b: Stream) -> bool:
    """Return whether two streams are parts of one recording that share any time, or hold the same readings.

    A recording that does not say its name counts as the same.
    """
    rssi, others = a.senses.anchor_rssi, b.senses.anchor_rssi
    if set(a.hashes) & set(b.hashes) or (rssi.size and np.array_equal(rssi, others, equal_nan=True)):
        return True
    one, other = (stream.notes.get("recording") for stream in (a, b))
    if one is not None and other is not None and one != other:
        return False
    starts = [float(stream.time[0] - stream.senses.dt[0, 0].max()) for stream in (a, b)]
    ends = [float(stream.time[-1]) for stream in (a, b)]
    return max(starts) < min(ends) - 1e-6


# ---- the study with the tuned configurations


def tuned_study(study: Study, tuned: Mapping[str, str], seed: int, both: bool) -> Study:
    """Return the study with the tuned label of every estimator; `both`: beside its own label."""
    blocks: dict[tuple[str, tuple[str, ...], str], list[str]] = {}
    for cell in study.cells():
        labels = [name for label in cell.estimators for name in ((label, tuned[label]) if both else (tuned[label],))]
        baseline = cell.baseline if both else tuned[cell.baseline]
        blocks.setdefault((cell.experiment, tuple(dict.fromkeys(labels)), baseline), []).append(cell.scenario)
    also = tuple(
        Block(scenarios=tuple(scenarios), estimators=labels, baseline=baseline, experiment=experiment)
        for (experiment, labels, baseline), scenarios in blocks.items()
    )
    name = f"{study.name}-{'shipped-and-tuned' if both else 'tuned'}"
    emptied: dict[str, Any] = dict.fromkeys(("scenarios", "estimators", "only"), ())
    emptied |= {"baseline": "", "variants": {}, "minutes": None, "streams": {}}
    return study.model_copy(update={**emptied, "name": name, "also": also, "tuned_with": seed})


def as_toml(study: Study) -> str:
    """Return the text of a study's file."""
    known = study.model_dump()
    text = "# Made by cooploc tune: every estimator as it was tuned, on streams of a seed that no run may have.\n"
    text += "".join(f"{key} = {toml(known[key])}\n" for key in ("about", "trials", "seed", "time_limit", "tuned_with"))
    for block in study.also:
        lines = {key: toml(value) for key, value in block.model_dump().items() if value}
        text += "\n[[also]]\n" + "".join(f"{key} = {value}\n" for key, value in lines.items())
    if study.training:
        text += "\n[training]\n" + "".join(f"{toml(key)} = {toml(value)}\n" for key, value in study.training.items())
    return text


# ---- tables


def history(finishes: Sequence[Finish]) -> pd.DataFrame:
    """Return one row per configuration that was tried, in the order in which it entered.

    Columns: `estimator`, `number`, `label`; `state`, "finished", or "stopped" as hopeless; `rounds`; `trials` that it
    used; `spent`, those of its estimator until then; `score`, its mean over its rounds; `gain`, how much smaller that
    is than the shipped one's on the same rounds; `best`, whether it was the best until then; and "value: NAME" for
    every parameter.
    """
    rows = []
    for finish in finishes:
        for entrant in finish.entrants:
            row = {name: getattr(entrant, name) for name in ("number", "label", "state", "rounds")}
            score, before = (one.mean(finish.lanes, entrant.rounds) for one in (entrant, finish.entrants[0]))
            row |= {"trials": len(entrant.scores), "spent": entrant.spent, "score": score, "gain": before - score}
            written = parse(entrant.label)[1]
            values = {f"{VALUE}{key}": written.get(key, one.default) for key, one in finish.space.parameters.items()}
            rows.append({"estimator": finish.shipped, **row, "best": entrant.best, **values})
    return pd.DataFrame(rows)


def gains(rows: pd.DataFrame, finishes: Sequence[Finish], objective: str) -> pd.DataFrame:
    """Return one row per scenario and estimator: as shipped and as tuned on the same fresh streams.

    Columns:
        scenario, estimator: as the study has it; tuned: the label of the tuned configuration
        rmse [m], nll [nats], anees, consistency, coverage95, failed: each `_shipped` and `_tuned`, as of `compare`
        score_shipped, score_tuned: the mean of what was made small, in its unit
        change, change_low, change_high: RMSE tuned / shipped - 1, with its paired 95 % interval
        p_holm: p of that difference, adjusted by Holm over all rows
        training_gain: how much the mean score fell on the training streams, of which the best was chosen; nan where
            the scenario was not trained on
        fresh_gain, fresh_gain_low, fresh_gain_high: the same on fresh streams, with its paired 95 % interval
        rank_shipped, rank_tuned: by RMSE among the scenario's estimators; nan where a trial failed
    """
    of = {one.shipped: one for one in finishes}
    table = pd.DataFrame(
        [
            _compare_pair(part[part["estimator"].isin({name, of[name].best.label})], str(scenario), of[name], objective)
            for scenario, part in rows.groupby("scenario", sort=False)
            for name in part["estimator"].unique()
            if name in of
        ]
    )
    table["p_holm"] = statistics.holm(table["p"].to_numpy(float))
    for which in SIDES:
        ranked = table[f"rmse_{which}"].where(table[f"failed_{which}"] == 0)
        table[f"rank_{which}"] = ranked.groupby(table["scenario"]).rank(method="min")
    return table.drop(columns="p")


def _compare_pair(rows: pd.DataFrame, scenario: str, finish: Finish, objective: str) -> dict[str, Any]:
    shipped, best = finish.shipped, finish.best.label
    records = {row["estimator"]: row for row in compare(rows, baseline=shipped, full=True).to_dict("records")}
    before, after = records[shipped], records[best]
    scores = {label: trial_scores(part, objective) for label, part in rows.groupby("estimator")}
    fresh = FIXED.mean(np.asarray(scores[shipped] - scores[best], float))
    lane, rounds = [one for one in finish.lanes if one.judged == scenario], finish.rounds
    same = best == shipped
    return {
        "scenario": scenario,
        "estimator": shipped,
        "tuned": best,
        "trials": int(before["trials"]),
        **{f"{name}_{which}": row[name] for name in SHOWN for which, row in zip(SIDES, (before, after), strict=True)},
        "score_shipped": scores[shipped].mean(),
        "score_tuned": scores[best].mean(),
        **{name: 0.0 if same else after[name] for name in ("change", "change_low", "change_high")},
        "p": np.nan if same else after["p"],
        "training_gain": finish.entrants[0].mean(lane, rounds) - finish.best.mean(lane, rounds) if lane else np.nan,
        "fresh_gain": fresh.value,
        "fresh_gain_low": fresh.low,
        "fresh_gain_high": fresh.high,
    }


def order(rows: pd.DataFrame, tuned: Mapping[str, str], by: str = "rmse") -> pd.DataFrame:
    """Compare every pair of estimators without failed trials, as shipped and as tuned; one row per scenario and pair.

    Columns: `scenario`, `a`, `b`: labels as shipped; `shipped`, `tuned`: the one with the smaller mean error, or
    empty where the difference is not significant (Holm over all pairs of all scenarios, in each of the two alone);
    `smaller_shipped`, `smaller_tuned`: that one, significant or not; `became`: "kept" (the same is significantly
    better), "reversed" (the other one is), "appeared" and "vanished" (significant only tuned, or only as shipped),
    "open" (neither).
    """
    found = []
    for scenario, part in rows.groupby("scenario", sort=False):
        values = pd.DataFrame(
            {
                str(label): weighted_means(own, ["trial"], ["mse"])["mse"] if by == "rmse" else trial_scores(own, by)
                for label, own in part.groupby("estimator", sort=False)
                if len(drop_failed(own)) == len(own)
            }
        )
        for a, b in combinations([one for one in tuned if one in values and tuned[one] in values], 2):
            row: dict[str, Any] = {"scenario": scenario, "a": a, "b": b}
            for which, pair in zip(SIDES, ([a, b], [tuned[a], tuned[b]]), strict=True):
                x, y = values[pair].dropna().to_numpy(float).T
                row[f"smaller_{which}"] = {1: a, -1: b}.get(np.sign(y.mean() - x.mean()), "")
                row[f"p_{which}"] = np.nan if np.array_equal(x, y) else _p_value(x, y, by)
            found.append(row)
    columns = [f"{what}_{which}" for which in SIDES for what in ("smaller", "p")]
    table = pd.DataFrame(found, columns=["scenario", "a", "b", *columns])
    for which in SIDES:
        adjusted = statistics.holm(table.pop(f"p_{which}").to_numpy(float))
        table[which] = table[f"smaller_{which}"].where(adjusted < SIGNIFICANCE, "")
    p, t = table["shipped"], table["tuned"]
    outcomes = [(p != "") & (p == t), (p != "") & (t != ""), p != "", t != ""]
    table["became"] = np.select(outcomes, ["kept", "reversed", "vanished", "appeared"], "open")
    return table


def _p_value(x: Any, y: Any, by: str) -> float:
    """Return p against equal RMSE, as of `change`; against equal mean scores, maybe negative, by the t test."""
    return FIXED.p_of_difference(x, y) if by == "rmse" else FIXED.p_of_mean(FIXED.mean(y - x), len(x), 0)
