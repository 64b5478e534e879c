"""The trial of a drafted log.toml: it is changed, line by line, until the recordings that it describes run."""

from pathlib import Path
from typing import NamedTuple

import numpy as np

from cooploc.estimators.errors import BadInput
from cooploc.scenarios.recordings import schema
from cooploc.scenarios.recordings.fit import UnfittedModel
from cooploc.scenarios.recordings.inspect.draft_toml import Draft, DraftTable, Entry, common_span
from cooploc.scenarios.recordings.inspect.finding import Finding
from cooploc.scenarios.recordings.scenario import NO_ORDER, TeamScenario
from cooploc.scenarios.recordings.team_log import TeamLog

USUAL = {  # values of [model] where a recording is too short to fit them
    **{"sigma_v": 0.1, "sigma_omega": 0.2, "sigma_move": 0.05},
    **{"range_bias": 0.0, "range_sigma": 0.2, "anchor_range_bias": 0.0, "anchor_range_sigma": 0.2},
    **{"A": -45.0, "eta": 2.0, "rssi_sigma": 5.0, "anchor_A": -45.0, "anchor_eta": 2.0, "anchor_rssi_sigma": 5.0},
    **{"sighting_sigma_range": 0.2, "sighting_sigma_bearing": 0.1},
    **{"landmark_sigma_range": 0.2, "landmark_sigma_bearing": 0.1},
}
TOO_SHORT = "the recording is too short to fit it: a usual value"
FALLBACKS = (  # each on top of those before, until the draft runs
    DraftTable("fit", (Entry("on", "nothing", "too short for a part that is fitted on and not judged", "perhaps"),)),
    DraftTable("prior", (Entry("heading", "unknown", "the recording shows none at its start", "perhaps"),)),
    DraftTable("prior", (Entry("position", "arena", "no true position at the start", "perhaps"),)),
)


class Trial(NamedTuple):
    """The result of running all recordings that a log.toml describes."""

    problem: str  # why they do not run; "" if they do
    lines: tuple[str, ...] = ()  # what is judged of each, and why it may rank nothing


def try_recordings(data: Path, description: schema.TeamDescription) -> Trial:
    """Simulate every run that a description finds in a directory.

    Raises:
        BadInput: one cannot be simulated.

    """
    scenario, lines = TeamScenario.from_description(data, description), []
    for k in range(scenario.count()):
        run = scenario.at([k])
        truth, stream = run.simulate("log", [k], 0, run.world())
        if not truth.valid.any():
            raise BadInput(f"run {run.run!r}: no true position is known in the part that is judged")
        seconds = stream.world.tick * len(stream.time)
        robots = f"{stream.robots} robot{'s' * (stream.robots > 1)}"
        weak = f"; it {NO_ORDER}: " + "; ".join(reasons) if (reasons := run.weaknesses(truth, stream)) else ""
        lines.append(f"run {run.run!r}: {robots}, {seconds:.3g} s are judged{weak}")
    return Trial("", tuple(lines))


def common_robots(log: TeamLog) -> tuple[str, ...]:
    """Return the robots with truth, without those that leave less than a tenth of the time in which all are there."""
    kept = [i for i, truth in enumerate(log.truth) if truth is not None] or list(range(len(log.robots)))
    longest = max((common_span(log, [i]) for i in kept), default=0.0)
    while len(kept) > 1 and common_span(log, kept) < 0.1 * longest:
        kept = max(([j for j in kept if j != i] for i in kept), key=lambda some: common_span(log, some))
    return tuple(log.robots[i] for i in kept)


def run_draft(data: Path, home: Path, draft: Draft, findings: tuple[Finding, ...]) -> tuple[Draft, Trial]:
    """Return a draft that runs, changed where it did not, and what it then runs; else the draft and the problem."""
    changed, problems = draft, []
    offsets = [float(f.setting.split()[2].rstrip(";")) for f in findings if (f.kind, f.table) == ("clock", "truth")]
    why = "the clocks share no time: found by the motion"
    clock = (Entry("clock_offset", float(np.median(offsets)), why, "perhaps"),) if offsets else ()
    for fallback in (None, *[DraftTable("truth", clock)] * bool(clock), *FALLBACKS):
        changed = changed if fallback is None else _with(changed, fallback, replace=fallback.name == "fit")
        for _ in USUAL:
            try:
                description = schema.parse(home, changed.text(), schema.TeamDescription, schema.EXAMPLE)
                return changed, try_recordings(data, description)
            except UnfittedModel as e:
                usual = tuple(Entry(name, USUAL[name], TOO_SHORT, "perhaps") for name in e.names if name in USUAL)
                changed = _with(changed, DraftTable("model", usual))
                problems.append(str(e))
            except BadInput as e:
                problems.append(str(e))
                break
    return draft, Trial(problems[0])


def _with(draft: Draft, change: DraftTable, replace: bool = False) -> Draft:
    """Return the draft with the entries of a table changed or added; or all of them replaced."""
    keys = {entry.key for entry in change.entries}
    tables = list(draft.tables)
    at = next((i for i, table in enumerate(tables) if table.name == change.name), len(tables))
    old = tables[at] if at < len(tables) else DraftTable(change.name, ())
    kept = () if replace else tuple(entry for entry in old.entries if entry.key not in keys)
    tables[at : at + 1] = [old._replace(entries=(*kept, *change.entries))]
    return draft._replace(tables=tuple(tables))
