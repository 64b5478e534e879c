"""Tables of a tuning for readers: as published and tuned, with the gain on training streams and on fresh ones."""

import pandas as pd

from cooploc.analysis.formats import change, count, fixed, interval, metres, p_value, ratio
from cooploc.analysis.report.tables import Table, numbers, words
from cooploc.estimators.plugins.labels import parse


def gain(value: float) -> str:
    """A difference of scores [nats, or log m], with its sign."""
    return f"{'+' if round(value, 2) > 0 else ''}{fixed(value, 2)}"


def parameters(label: str) -> str:
    """What a configuration states, without the estimator's name; "as published" stands for nothing."""
    return ", ".join(f"{key}={value}" for key, value in parse(label)[1].items())


GAINS = (
    words("estimator"),
    numbers("RMSE published [m]", "rmse_published", form=metres),
    numbers("tuned [m]", "rmse_tuned", form=metres),
    numbers("change", "change", form=change),
    numbers("95 %", "change_low", "change_high", form=interval(change)),
    numbers("p", "p_holm", form=p_value),
    numbers("NLL published", "nll_published", form=ratio),
    numbers("tuned", "nll_tuned", form=ratio),
    numbers("ANEES published", "anees_published", form=ratio),
    numbers("tuned", "anees_tuned", form=ratio),
    numbers("training gain", "training_gain", form=gain),
    numbers("fresh gain", "fresh_gain", form=gain),
    numbers("95 %", "fresh_gain_low", "fresh_gain_high", form=interval(gain)),
    numbers("rank published", "rank_published", form=count),
    numbers("tuned", "rank_tuned", form=count),
    numbers("failed", "failed_tuned", form=count),
)
LEGEND = (
    "change: of RMSE by tuning, on the same fresh streams, with Fieller's interval; p: Holm over the whole table. "
    "training gain: how much the mean score fell on the streams that the best configuration was chosen on; fresh gain: "
    "on streams that tuning never saw. Where the first is larger, the difference is over-fitting. rank: by RMSE."
)


def gains_table(scenario: str, part: pd.DataFrame) -> Table:
    """One scenario's estimators, by their error as published."""
    ordered = part.sort_values("rmse_published", kind="stable")
    caption = f"{scenario}: {count(part['trials'].max())} fresh trials"
    return Table("tuned", caption, GAINS, ordered.to_dict("records"))


def chosen_table(history: pd.DataFrame, tuned: dict[str, str]) -> Table:
    """What was tuned of every estimator, and what it took."""
    rows = [
        {
            "estimator": str(name),
            "tuned": "as published" if tuned[str(name)] == name else parameters(tuned[str(name)]),
            "configurations": len(part),
            "stopped": (part["state"] == "stopped").sum(),
            "trials": part["trials"].sum(),
        }
        for name, part in history.groupby("estimator", sort=False)
    ]
    columns = (words("estimator"), words("tuned"), *map(numbers, ("configurations", "stopped", "trials")))
    caption = "what was chosen, of how many configurations, how many of them were stopped early, and all their trials"
    return Table("chosen", caption, columns, rows)


def order_sentence(table: pd.DataFrame, by: str) -> str:
    """What tuning did to the order of all pairs, in one sentence."""
    n, of = len(table), table["became"].value_counts()
    changed = (table["smaller_published"] != table["smaller_tuned"]).sum()
    return (
        f"By {by}, {of.get('reversed', 0)} of {n} pairs of estimators in a scenario are significantly reversed by "
        f"tuning, {of.get('kept', 0)} keep a significant order, {of.get('appeared', 0)} are told apart only when "
        f"tuned, {of.get('vanished', 0)} only as published, {of.get('open', 0)} in neither; significant or not, the "
        f"smaller error changes sides in {changed}."
    )
