"""Writes reports/paper/summary.pdf, two pages in LaTeX, from the runs and tables of the other reports.

Run: python reports/summary.py RUNS [OUT [draft]]. It needs pdflatex and IEEEtran:
apt-get install texlive-publishers.
"""

import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from page import written

from cooploc.estimators.plugins.errors import BadInput


def main(runs: str, out: str = "reports/paper", draft: str = "") -> None:
    """Write the PDF."""
    if not (latex := shutil.which("pdflatex")):
        raise BadInput("pdflatex is not there; apt-get install texlive-publishers")
    with tempfile.TemporaryDirectory() as scratch:
        (Path(scratch) / "summary.tex").write_text(written("summary.tex.j2", runs, bool(draft)), encoding="utf-8")
        shutil.copy(Path(out).parent / "readings" / "map.pdf", scratch)
        command = [latex, "-interaction=nonstopmode", "-halt-on-error", "summary.tex"]
        for _ in range(2):  # the second time with the numbers of the tables
            done = subprocess.run(command, cwd=scratch, capture_output=True, text=True, check=False)
        if done.returncode:
            said = [line for line in done.stdout.splitlines() if line.startswith("!")]
            raise BadInput(f"pdflatex ended with {done.returncode}: {said[:1]}; correct reports/text/summary.tex.j2")
        shutil.copy(Path(scratch) / "summary.pdf", out)


if __name__ == "__main__":
    try:
        main(*sys.argv[1:])
    except BadInput as error:
        sys.exit(f"reports/summary.py: {error}")
