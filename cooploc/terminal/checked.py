"""What `cooploc check` prints: a row for each check on a terminal, a line for each elsewhere."""

from cooploc.analysis.report.tables import Table, words
from cooploc.scenarios.conformance.report import Report, sentences
from cooploc.terminal.console import wide

COLUMNS = words("check"), words("result"), words("what was tried and found", "found")


def show(report: Report) -> None:
    """Print the results, and how many checks ran, passed, failed and were skipped."""
    console = wide()
    if not console.is_terminal:
        console.print(report.table())
        return
    alike: dict[tuple[str, str], list[str]] = {}
    for one in report.results:
        alike.setdefault((one.status, "\n".join(sentences(one))), []).append(one.check)
    rows = [{"check": _named(checks), "result": status, "found": found} for (status, found), checks in alike.items()]
    console.print(Table("checks", "", COLUMNS, rows).terminal(wrap=True))
    console.print(report.summary())


def _named(checks: list[str]) -> str:
    return checks[0] if len(checks) == 1 else f"{len(checks)} others"
