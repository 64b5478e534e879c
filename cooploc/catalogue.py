"""The table of estimators in the documentation, made from the code: `cooploc list estimators --markdown`."""

from typing import Any

from cooploc.estimators import BUILTIN, make
from cooploc.estimators.listing import listing
from cooploc.scenarios import simulate
from cooploc.scenarios.runner.tick import IncompatibleEstimator
from cooploc.scenarios.runner.trace import trace

# What each sends, and what theory says of its covariance; a class may say both itself, by `sends` and `consistency`.
# What runs say of it stands in every table of results.
KNOWN = {
    "dead-reckoning": ("nothing", "consistent"),
    "arl": ("nothing", "over-confident: a constant angle error, smoothed angles"),
    "rssi-pf": ("nothing", "consistent but for the number of particles"),
    "mrsl-rssi": ("mean and covariance", "over-confident: counts shared beliefs again and again"),
    "mrsl-distance": ("mean and covariance", "over-confident: counts shared beliefs again and again"),
    "ctrn": ("mean and covariance", "as `arl` alone; the fusion adds no over-confidence"),
    "cmrl": ("a sample of particles", "over-confident, less so than `mrsl-*`: a detection counts once per 2.5 m"),
    "reciprocal-pf": ("particles as clusters", "no guarantee: repeated counting narrows it, draws widen it"),
    "channel-pf": ("mean, covariance, odometry", "over-confident: a link does not see what comes around others"),
    "ekf-local": ("nothing", "consistent up to linearisation"),
    "ekf-joint": ("every reading", "consistent up to linearisation"),
    "ekf-naive": ("mean, covariance, sightings", "over-confident: counts shared beliefs again and again"),
    "ekf-ci": ("mean, covariance, sightings", "conservative by construction"),
    "ekf-split-ci": ("mean, both covariances, sightings", "between naive and CI; `form=conservative` is conservative"),
    "ekf-ici": ("mean, covariance, sightings", "a bound where robots share common information alone; else not"),
    "ekf-hmd": ("mean, covariance, sightings", "no bound is known"),
    "ekf-event-ci": ("as `ekf-ci`, when the belief has changed", "conservative by construction"),
    "ekf-gs-ci": ("mean and covariance of the whole team", "conservative, if `drift` is at least the motion"),
    "ekf-luft": ("belief and cross factor, on request", "approximate: correlations with third robots are guessed"),
    "ekf-interim": ("belief on request, updates to all", "that of `ekf-joint` until the first message is lost"),
    "iekf-joint": ("every reading", "consistent up to linearisation; learns no common heading from teammates"),
    "ukf-joint": ("every reading", "consistent up to the unscented transform"),
    "gbp": ("messages of both ends of each reading", "over-confident: what comes around a loop counts as new"),
    "map-joint": ("every reading", "consistent where the models are right"),
}
SCENARIOS = ("robots-1-3/n=3[ticks=5]", "camera/n=3[ticks=20]")


def markdown() -> str:
    """One row per built-in estimator: what it is, senses and sends, what that costs, and how far it can be trusted."""
    head = ["name", "what it is", "senses", "sends", "bytes per message", "known consistency", "source"]
    known = listing().set_index("name").loc[list(BUILTIN)].reset_index()
    rows = [_row(row) for row in known.to_dict("records")]
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join(f"| {' | '.join(cells)} |" for cells in lines)


def _row(row: dict[Any, Any]) -> list[str]:
    about = row["about"].partition(". ")[0].rstrip(".")
    senses = row["uses"].replace("|", " or ").replace("_", " ")
    bound = " **The bound** of all others." if row["bound"] else ""
    cls = type(make(row["name"]))
    own = getattr(cls, "sends", "as its source says"), getattr(cls, "consistency", "not known")
    sends, consistency = KNOWN.get(row["name"], own)
    return [f"`{row['name']}`", f"{about}.{bound}", senses, sends, _bytes(row["name"]), consistency, row["source"]]


def _bytes(name: str) -> str:
    """Measured on three robots: the mean bytes of a message where radio, and where cameras, see teammates."""
    found = []
    for label in SCENARIOS:
        _, stream = simulate(label, trials=2, seed=1)
        try:
            sent = trace(name, make(name), stream)
        except IncompatibleEstimator:
            continue
        if sent.messages.sum():
            found.append(f"{sent.bytes.sum() / sent.messages.sum():.0f}")
    return ", ".join(found)
