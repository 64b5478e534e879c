"""Writes reports/reproduced.md: some trials of every run behind these reports, run again.

Run: python reports/reproduced.py RUNS [DATA [OUT]], where RUNS is the folder of the run directories. Exit code 1 where
a result is not bit-equal.
"""

import sys
from pathlib import Path

import cooploc as cl
from cooploc.analysis.report.tables import Table, numbers, words

TRIALS = 6
RECORDED = {"mrclam": "mrclam6", "wifi-priors": "wifi-rssi"}  # runs on recordings, and the folder of these
TEXT = """# Every report's runs, run again

    python reports/reproduced.py RUNS DATA      # RUNS: the folder of the run directories

Of each run {trials} trials, each of another scenario where there are as many, with all estimators that ran there.
`cooploc reproduce RUN_DIR` lists the results one by one.

{table}
"""
COLUMNS = (words("run"), numbers("results"), numbers("bit-equal", "equal"), words("not equal", "unlike"))


def main(runs: str, data: str = "../shared/data", out: str = "reports") -> int:
    """Write the page; 1 where a result came out otherwise."""
    rows = []
    for run in sorted(path.parent for path in Path(runs).glob("*/parts")):
        recordings = Path(data) / RECORDED[run.name] if run.name in RECORDED else None
        if recordings and not recordings.exists():
            print(f"{run.name}: {recordings} is not there", file=sys.stderr)
            continue
        found = cl.reproduce(run, TRIALS, recordings).table
        unlike = found[~found["equal"]]
        told = "; ".join(f"{one.estimator} in {one.scenario}: {one.remark}" for one in unlike.head(2).itertuples())
        rows.append({"run": run.name, "results": len(found), "equal": int(found["equal"].sum()), "unlike": told})
    table = Table("reproduced", "", COLUMNS, rows).markdown().rstrip()
    (Path(out) / "reproduced.md").write_text(TEXT.format(trials=TRIALS, table=table), encoding="utf-8")
    return int(any(row["equal"] < row["results"] for row in rows))


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
