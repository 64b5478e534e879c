"""The text of log.toml for a draft: its tables, what follows from the recording, and the findings beside them."""

from pathlib import Path

from cooploc.scenarios.recordings.inspect.draft import Draft
from cooploc.scenarios.recordings.inspect.finding import Finding
from cooploc.scenarios.recordings.inspect.settings import arena_entry
from cooploc.scenarios.recordings.inspect.toml_text import Entry, Table, one_line, written
from cooploc.scenarios.recordings.team_log import TeamLog


def log_toml(
    path: Path, why: str, draft: Draft, log: TeamLog, odd: tuple[Finding, ...], more: tuple[Table, ...] = ()
) -> str:
    """The whole text; `more` are tables that follow from what was read, `why` is why the format is what it is."""
    name = path.resolve().name
    head = (
        f"What the recordings in {one_line(name)} mean, as `cooploc inspect` guesses ({why}).",
        "Each line says where its value comes from, and how sure that is: sure, likely or perhaps. Correct what is",
        "wrong, and run it: cooploc run log --data DIR. What was FOUND stands where it belongs, and changes nothing.",
        *(f"Not used: {one_line(line)}" for line in draft.unused),
    )
    about = Entry("about", f"recording {one_line(name)}", "shown in reports; say who recorded it, and where", "perhaps")
    tables = (*draft.tables, *more)
    placed = {table.name for table in tables}
    others = tuple(_remark(f) for f in odd if f.change.table not in placed)
    first = {table.name: table for table in reversed(tables)}
    tables = tuple(_with_findings(table, odd) if first[table.name] is table else table for table in tables)
    if others:
        tables += (Table("model", (), (*others, "What is not stated here is fitted.")),)
    return written(head, (*draft.entries, about, *arena_entry(log)), tables)


def _with_findings(table: Table, odd: tuple[Finding, ...]) -> Table:
    """A table with remarks for the findings that it would correct."""
    return table._replace(remarks=(*table.remarks, *(_remark(f) for f in odd if f.change.table == table.name)))


def _remark(f: Finding) -> str:
    source = f"({Path(f.source).name})" if f.source else ""
    whose = " ".join(word for word in (f.robot, source) if word)
    names = f"{', '.join(f.change.names)}: " if f.change.names else ""
    said = f"FOUND ({f.sure}): {f.kind}{f', {whose}' if whose else ''}: {f.fact}. To change: {names}{f.change.setting}"
    return one_line(said)
