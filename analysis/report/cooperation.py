"""What cooperation buys, in sentences made from the matrix of information alone."""

from typing import Any

import pandas as pd

from cooploc.analysis.formats import change, counted, interval, listed, metres, percent, ratio

OWN = {
    "none": "no reading of their own",
    "doa": "the direction of arrival",
    "gradient": "the gradient",
    "rssi": "the four raw readings",
}
RULES = {
    ("product", "particles"): "the product of beliefs",
    ("intersection", "particles"): "covariance intersection of particle filters",
    ("intersection", "Kalman"): "covariance intersection of Kalman filters",
    ("centralised", "Kalman"): "a Kalman filter of the whole team",
    ("bound", "MAP"): "the bound",
}
FILTERS = {"particles": "with particles", "Kalman": "with a Kalman filter", "MAP": "by the bound"}
NOTHING = 5e-4  # a change whose whole interval is smaller
BETWEEN = {"rssi": "RSSI", "range": "ranges"}


def sentences(table: pd.DataFrame) -> list[tuple[str, int, list[str]]]:
    """For each own reading and team of more than one robot: (own, robots, sentences).

    The first says how large errors and floor are alone, each other one what a rule of fusion buys.

    Args:
        table: from `cl.information`.

    """
    found = []
    for (own, robots), part in table[table["robots"] > 1].groupby(["own", "robots"], sort=False):
        said = [_alone(part)]
        for rule, name in RULES.items():
            mine = part[(part["fusion"] == rule[0]) & (part["filter"] == rule[1]) & part["change"].notna()]
            if len(mine):
                said.append(_rule(name, mine))
        found.append((str(own), int(str(robots)), said))
    return found


def heading(own: str, robots: int) -> str:
    """The beginning of such a paragraph."""
    return f"{counted(robots, 'robot')} with {OWN[own]}"


def _alone(part: pd.DataFrame) -> str:
    """The errors and the floor without teammates, and how far the floor falls with them."""
    alone = part[part["between"] == "none"]
    errors = [f"{metres(row['rmse'])} m {FILTERS[row['filter']]}" for row in alone.to_dict("records")]
    said = f"Alone they err by {listed(errors)}." if errors else "None of them was run alone."
    floor = alone["floor"].min()
    together = part[part["between"] != "none"].groupby("between", sort=False)["floor"].min().dropna()
    falls = [f"{change(low / floor - 1)} by {BETWEEN[str(name)]}" for name, low in together.items()]
    if floor != floor or not falls:
        return said
    return f"{said} The floor, {metres(floor)} m alone, changes by {listed(falls)}."


def _rule(name: str, mine: pd.DataFrame) -> str:
    rows = mine.to_dict("records")
    said = f"{name[0].upper()}{name[1:]} {listed(effect(row) for row in rows)}"
    over = [f"{BETWEEN[row['between']]}: ANEES {ratio(row['anees'])}" for row in rows if _over_confident(row)]
    return f"{said}{f', but is over-confident ({listed(over)})' if over else ''}."


def effect(row: dict[Any, Any]) -> str:
    """What a reading changes in the error, against the same filter alone, by its interval."""
    size, low, high = float(row["change"]), float(row["change_low"]), float(row["change_high"])
    by = BETWEEN[row["between"]]
    if max(abs(low), abs(high)) < NOTHING:
        return f"leaves the error as it is by {by}"
    if low != low:
        return f"changes the error by {change(size)} by {by} (no interval)"
    if low <= 0 <= high:
        return f"makes no difference that {counted(int(row['trials']), 'trial')} show by {by} ({_between(low, high)})"
    verb = "takes {} off the error" if size < 0 else "adds {} to the error"
    return f"{verb.format(percent(abs(size)))} by {by} ({_between(low, high)})"


def _between(low: float, high: float) -> str:
    return interval(change)(low, high)


def _over_confident(row: dict[Any, Any]) -> bool:
    return bool(row["consistency"] == "over-confident")
