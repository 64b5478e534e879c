"""Sections of reports/reliability.md, each replaced by the command that measures it; what is beside them stays."""

from pathlib import Path

HEAD = """# Reliability

Made by `make reliability`, which takes an hour: `crash_matrix.py`, `damage.py`, `report_size.py` and
`isolation_price.py` in `benchmarks/reliability` measure their sections, and replace them here.
"""


def put(report: Path, name: str, text: str) -> None:
    """Into the report, in place of the section of this name, or behind the last one."""
    start, end = f"<!-- {name} -->", f"<!-- end of {name} -->"
    there = report.read_text() if report.exists() else HEAD
    before, _, rest = there.partition(start)
    after = rest.partition(end)[2].strip()
    report.write_text(f"{before.rstrip()}\n\n{start}\n{text.strip()}\n{end}\n" + (f"\n{after}\n" if after else ""))
