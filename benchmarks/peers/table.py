"""Writes reports/peers.md: other people's filters as plug-ins, how much glue they need, and how they do.

Run: python benchmarks/peers/table.py REPORT [DATA], where DATA holds MRCLAM (mrclam6/); a library that is not installed
is left out, with the reason. Certificates and results stay in build/peers, and a second run goes on from there.
"""

import inspect
import os
import sys
from pathlib import Path

import numpy as np

import cooploc as cl
from cooploc.analysis.execution.run_directory import read_run
from cooploc.analysis.metrics.ranking import short_certificate
from cooploc.scenarios.runner.trace import trace

HERE = Path(__file__).parent
OURS = "ekf-local[anchor_reading=rssi]"
PEERS = {
    "filterpy_filters.py": ("Kalman", "Imm", "Ukf", "Ckf", "Enkf"),
    "stone_soup.py": ("StoneSoupEkf", "StoneSoupParticles"),
    "gtsam_map.py": ("GtsamMap",),
    "jax_ekf.py": ("JaxEkf",),
    "navlie_ekf.py": ("NavlieEkf",),
}
SMALL = {"robots-1-3/n=3": {"ticks": 30}, "camera/n=3": {"ticks": 30}}
HEAD = """# Other people's filters as plug-ins

    python benchmarks/peers/table.py reports/peers.md      # MRCLAM is read from mrclam6/ in COOPLOC_DATA

Each is a plain class for one robot in `benchmarks/peers/`, wrapped by `cl.PerRobot`, and named on the command line:
`cooploc run quick --estimators ekf-local,benchmarks/peers/filterpy_filters.py:Ukf[alpha=0.5]`. They use odometry, and
anchors or landmarks. *Glue*: lines of the class, without what it inherits. *Apart*: largest distance of its positions
from those of `{ours}` without a gate, on three robots in the arena and with cameras, 2 trials of 30 ticks
each; those that compute the same agree to rounding. *Checks*: the certificate, with what it leaves out.
RMSE [m] in a minute of five real robots (`mrclam/all`) and in 4 trials of `robots-1-3/n=3[ticks=60]`, as in the study
`quick` but shorter; microseconds of processor time for a robot and tick of the former.
filterpy and GTSAM are in the lock; the other libraries are tried where they are on PYTHONPATH.

"""


def glue_lines(estimator: cl.PerRobot) -> int:
    """Return the number of lines of a class, without empty ones."""
    return sum(bool(line.strip()) for line in inspect.getsource(estimator.make).splitlines())  # type: ignore[arg-type]


def apart(estimator: cl.PerRobot) -> str:
    """The largest distance [m] of its positions from ours, in both small worlds."""
    ours, found = cl.make(OURS, gate=np.inf), []
    for label, how in SMALL.items():
        _, stream = cl.simulate(label, trials=2, seed=3, **how)
        x, reference = (trace("it", one, stream).x[..., :2] for one in (estimator, ours))
        found.append(np.sqrt(((x - reference) ** 2).sum(-1)).max())
    return ", ".join(f"{one:.1g} m" for one in found)


def peers() -> tuple[list[tuple[str, str, str]], list[str]]:
    """(label, lines of glue, how far apart) of plug-ins whose library is there; why the others are not."""
    found, absent = [], []
    for file, names in PEERS.items():
        for name in names:
            label = f"{os.path.relpath(HERE / file)}:{name}"
            try:
                made = cl.make(label)
            except cl.BadInput as e:
                absent.append(str(e))
                break
            found.append((label, str(glue_lines(made)), apart(made)))
    return found, absent


def rows(found: list[tuple[str, str, str]], data: Path | None) -> list[list[str]]:
    """A row of the table for each, from one run of all."""
    out = Path("build/peers")
    labels = [OURS, *(label for label, _, _ in found)]
    study = HERE / ("peers.toml" if data else "peers-simulated.toml")
    table = cl.run_study(study, estimators=labels, data=data, out=out).table.set_index(["scenario", "estimator"])
    certificates = read_run(out).manifest["certificates"]
    worlds = list(dict.fromkeys(table.index.get_level_values(0)))
    made = []
    for label, glue, off in ((OURS, "", ""), *found):
        certificate = certificates.get(label)
        checks = short_certificate(f"{certificate['status']}: {certificate['found']}") if certificate else "built in"
        mine = [table.loc[(world, label)] for world in worlds]
        numbers = [f"{row['rmse']:.3f}" for row in mine] + [f"{1e6 * row['seconds']:.0f}" for row in mine[:1]]
        made.append([f"`{Path(label).name}`", glue, off, checks, *numbers])
    return [["estimator", "glue", "apart", "checks", *(f"RMSE, {w.partition('[')[0]}" for w in worlds), "µs"], *made]


def main(report: str, data: str = "") -> None:
    """Measure and write."""
    where = Path(data) if data else Path(os.environ.get("COOPLOC_DATA", HERE.parents[3] / "shared/data")) / "mrclam6"
    found, absent = peers()
    head, *body = rows(found, where if where.is_dir() else None)
    lines = [head, ["---"] * len(head), *body]
    text = HEAD.format(ours=OURS) + "".join(f"| {' | '.join(line)} |\n" for line in lines)
    text += "".join(f"\nNot here: {reason}\n" for reason in absent)
    Path(report).write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main(*sys.argv[1:])
