"""Sections of reports/reliability.md, each replaced by the command that measures it; what is beside them stays."""

from fcntl import LOCK_EX, flock
from pathlib import Path

HEAD = """# Reliability

Made by `make reliability`, or with all other pages by `make reports`: `crash_matrix.py`, `damage.py`, `report_size.py`
and `isolation_price.py` in `benchmarks/reliability` measure their sections, and replace them here.
"""


def put(report: Path, name: str, text: str) -> None:
    """Into the report, in place of the section of this name, or behind the last one; one process at a time."""
    start, end = f"<!-- {name} -->", f"<!-- end of {name} -->"
    with report.open("a+", encoding="utf-8") as file:
        flock(file, LOCK_EX)
        file.seek(0)
        before, _, rest = (file.read() or HEAD).partition(start)
        after = rest.partition(end)[2].strip()
        file.truncate(0)
        file.write(f"{before.rstrip()}\n\n{start}\n{text.strip()}\n{end}\n" + (f"\n{after}\n" if after else ""))
