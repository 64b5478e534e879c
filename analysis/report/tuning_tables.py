"""Tables of a tuning for readers: as shipped and tuned, with the gain on training streams and on fresh ones."""

import pandas as pd

from cooploc.analysis.formats import change, count, decimals, interval, metres, p_value, ratio
from cooploc.analysis.report.tables import Table, number_column, text_column
from cooploc.estimators.registry import parse


def gain(value: float) -> str:
    """Write a difference of scores [nats, or log m], with its sign."""
    return f"{'+' if round(value, 2) > 0 else ''}{decimals(value, 2)}"


def parameters(label: str) -> str:
    """Return a configuration's parameters in words."""
    return ", ".join(f"{key}={value}" for key, value in parse(label)[1].items())


GAINS = (
    text_column("estimator"),
    number_column("RMSE shipped [m]", "rmse_shipped", form=metres),
    number_column("tuned [m]", "rmse_tuned", form=metres, second_line=True),
    number_column("change", "change", form=change),
    number_column("95 %", "change_low", "change_high", form=interval(change), second_line=True),
    number_column("p", "p_holm", form=p_value, priority=3),
    number_column("score shipped", "score_shipped", form=ratio, priority=5),
    number_column("tuned", "score_tuned", form=ratio, second_line=True, priority=5),
    number_column("ANEES shipped", "anees_shipped", form=ratio, priority=4),
    number_column("tuned", "anees_tuned", form=ratio, second_line=True, priority=4),
    number_column("training gain", "training_gain", form=gain),
    number_column("fresh gain", "fresh_gain", form=gain, second_line=True),
    number_column("95 %", "fresh_gain_low", "fresh_gain_high", form=interval(gain), priority=2),
    number_column("rank shipped", "rank_shipped", form=count, priority=1),
    number_column("tuned", "rank_tuned", form=count, second_line=True, priority=1),
    number_column("failed", "failed_tuned", form=count),
)


def gains_table(scenario: str, part: pd.DataFrame) -> Table:
    """Return one scenario's estimators, by their error as shipped."""
    ordered = part.sort_values("rmse_shipped", kind="stable")
    caption = f"{scenario}: {count(part['trials'].max())} fresh trials"
    return Table("tuned", caption, GAINS, ordered.to_dict("records"))


def chosen_table(history: pd.DataFrame, tuned: dict[str, str]) -> Table:
    """Return the chosen parameters of every estimator, and what the search took."""
    rows = [
        {
            "estimator": str(name),
            "tuned": "as shipped" if tuned[str(name)] == name else parameters(tuned[str(name)]),
            "configurations": len(part),
            "stopped": (part["state"] == "stopped").sum(),
            "trials": part["trials"].sum(),
        }
        for name, part in history.groupby("estimator", sort=False)
    ]
    columns = (
        text_column("estimator"),
        text_column("tuned"),
        *map(number_column, ("configurations", "stopped", "trials")),
    )
    caption = "what was chosen, of how many configurations, how many of them were stopped early, and all their trials"
    return Table("chosen", caption, columns, rows)


def order_sentence(table: pd.DataFrame, by: str) -> str:
    """Return in one sentence how tuning changed the order of all pairs."""
    n, of = len(table), table["became"].value_counts()
    changed = (table["smaller_shipped"] != table["smaller_tuned"]).sum()
    return (
        f"By {by}, {of.get('reversed', 0)} of {n} pairs of estimators in a scenario are significantly reversed by "
        f"tuning, {of.get('kept', 0)} keep a significant order, {of.get('appeared', 0)} are told apart only when "
        f"tuned, {of.get('vanished', 0)} only as shipped, {of.get('open', 0)} in neither; significant or not, the "
        f"smaller error changes sides in {changed}."
    )
