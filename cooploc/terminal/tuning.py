"""What `cooploc tune` prints."""

from collections.abc import Mapping
from typing import Any

import pandas as pd

from cooploc.analysis.report.tuning_tables import LEGEND, chosen_table, gains_table, order_sentence
from cooploc.terminal.console import wide


def show(
    history: pd.DataFrame, gains: pd.DataFrame, orders: Mapping[str, pd.DataFrame], record: dict[str, Any]
) -> None:
    """Print what was chosen, what it bought, and whether the order changed."""
    console = wide()
    console.print(chosen_table(history, record["tuned"]).terminal())
    console.print()
    for scenario, part in gains.groupby("scenario", sort=False):
        console.print(gains_table(str(scenario), part).terminal())
        console.print()
    console.print(LEGEND, style="dim")
    for name, order in orders.items():
        console.print(order_sentence(order, name))
    console.print(
        f"seed {record['seed']}, training seed {record['training_seed']}: "
        f"none of the {len(record['streams'])} training streams is a reported one"
    )
