"""The report in a real browser: nothing sticks out at 400 and 1400 pixels, tables sort, and it prints.

`make looks` installs Debian's Chromium, runs this, and leaves the pictures in build/looks for a person to look at.
"""

import html
import json
import os
import re
import shutil
import subprocess
from pathlib import Path

import pandas as pd
import pytest
from made_runs import kept_from, rows_of

from cooploc.analysis.claims.ledger import load
from cooploc.analysis.report import html_page

CHROMIUM = shutil.which("chromium")
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(CHROMIUM is None, reason="no chromium is installed: make looks installs it"),
]
MANY = {f"estimator-{i}[particles={100 * i},own=rssi]": (0.3 + 0.05 * i, 0.6 + 0.2 * i) for i in range(14)}
# A frame has the wanted width where a window of the browser has a least one; what it holds keeps its own policy.
FRAME = """<body style="margin:0"><iframe style="border:0;width:{width}px;height:{height}px" srcdoc="{page}"></iframe>
<pre id="told"></pre><script>
const frame = document.querySelector("iframe");
const errors = [];
frame.addEventListener("load", () => {{
  const inside = frame.contentDocument;
  frame.contentWindow.addEventListener("error", (e) => errors.push(e.message));
  const wide = inside.documentElement.scrollWidth;
  const table = inside.querySelector("#table-experiment-one");
  const column = [...table.tHead.rows[0].cells].findIndex((head) => head.textContent === "RMSE [m]");
  const values = () => [...table.tBodies[0].rows].map((row) => Number(row.cells[column].dataset.sort));
  const before = values();
  table.tHead.rows[0].cells[column].firstElementChild.click();
  const rising = values();
  table.tHead.rows[0].cells[column].firstElementChild.click();
  document.getElementById("told").textContent = JSON.stringify({{ wide, before, rising, falling: values(), errors }});
}});
</script></body>"""


def chromium(*options, cwd):
    flags = ["--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars", f"--user-data-dir={cwd / 'profile'}"]
    done = subprocess.run([CHROMIUM, *flags, *options], capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("looks")


@pytest.fixture(scope="module")
def report(folder):
    labels = [f"packet-drop/drop={d}[ticks=30]" for d in ("0", "0.3", "0.5", "0.9")] + ["trajectory"]
    rows = pd.concat([rows_of(label, MANY, bounds=(list(MANY)[2],)) for label in labels], ignore_index=True)
    return html_page.write(kept_from(rows, folder), load(), folder)


@pytest.mark.parametrize("width", [400, 1400])
def test_nothing_sticks_out_and_tables_sort(report, folder, width):
    file = folder / f"frame{width}.html"
    file.write_text(FRAME.format(width=width, height=9000, page=html.escape(report.read_text())))
    dom = chromium("--virtual-time-budget=5000", "--dump-dom", file.as_uri(), cwd=folder)
    told = json.loads(html.unescape(re.search(r'<pre id="told">(.*?)</pre>', dom, re.DOTALL)[1]))
    assert told["errors"] == []
    assert told["wide"] <= width
    assert told["rising"] == sorted(told["before"]) != told["before"]
    assert told["falling"] == sorted(told["before"], reverse=True)


@pytest.mark.parametrize("width", [400, 1400])
def test_it_can_be_looked_at(report, folder, width):
    file = folder / f"frame{width}.html"
    file.write_text(FRAME.format(width=width, height=9000, page=html.escape(report.read_text())))
    picture = _kept(folder) / f"report-{width}.png"
    chromium(f"--window-size={max(width, 500)},9000", f"--screenshot={picture}", file.as_uri(), cwd=folder)
    assert picture.read_bytes().startswith(b"\x89PNG")


def test_it_prints(report, folder):
    paper = _kept(folder) / "report.pdf"
    chromium("--no-pdf-header-footer", f"--print-to-pdf={paper}", report.as_uri(), cwd=folder)
    assert paper.read_bytes().startswith(b"%PDF")


def _kept(folder):
    """Where pictures are left: LOOKS, or with the test's other files."""
    place = Path(os.environ.get("LOOKS", folder)).resolve()
    place.mkdir(parents=True, exist_ok=True)
    return place
