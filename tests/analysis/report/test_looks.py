"""The report in a real browser, by day and by night: nothing sticks out, and tables sort and filter."""

import html
import json
import re
import shutil
import subprocess

import pandas as pd
import pytest
from made_runs import kept_from, rows_of

from cooploc.analysis.claims.ledger import load
from cooploc.analysis.report import html_page

CHROMIUM = shutil.which("chromium")
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(CHROMIUM is None, reason="no chromium is installed: apt-get install chromium"),
]
MANY = {f"estimator-{i}[particles={100 * i},own=rssi]": (0.3 + 0.05 * i, 0.6 + 0.2 * i) for i in range(14)}
# A frame has the wanted width where a window of the browser has a least one; what it holds keeps its own policy.
FRAME = """<meta charset="utf-8"><body style="margin:0">
<iframe style="border:0;width:{width}px;height:9000px" srcdoc="{page}"></iframe>"""
SCRIPT = """<pre id="result"></pre><script>
const frame = document.querySelector("iframe");
const errors = [];
frame.addEventListener("load", () => {
  const inside = frame.contentDocument, view = frame.contentWindow;
  view.addEventListener("error", (e) => errors.push(e.message));
  inside.querySelectorAll("details").forEach((one) => { one.open = true; });
  const wide = inside.documentElement.scrollWidth;
  const table = inside.querySelector("#table-experiment-one");
  const fits = table.parentElement.scrollWidth <= table.parentElement.clientWidth;
  const column = [...table.tHead.rows[0].cells].findIndex((head) => head.textContent.startsWith("RMSE [m]"));
  const rows = () => [...table.tBodies[0].rows].filter((row) => row.className !== "head");
  const number = (cell) => Number(cell.dataset.sort ?? cell.firstChild.textContent);
  const values = () => rows().map((row) => number(row.cells[column]));
  const button = table.tHead.rows[0].cells[column].querySelector("button");
  const before = values();
  button.click();
  const rising = values();
  button.click();
  const falling = values(), sign = view.getComputedStyle(button, "::after").content;
  const visible = () => [...table.querySelectorAll("[data-estimator]")].filter((row) => row.checkVisibility());
  const all = visible().length;
  inside.querySelector("#filters input").click();
  const some = visible().length;
  const first = visible()[0].cells[0].getBoundingClientRect().left;
  table.parentElement.scrollLeft = 500;
  const fixed = visible()[0].cells[0].getBoundingClientRect().left === first;
  const ground = view.getComputedStyle(inside.body).backgroundColor;
  document.getElementById("result").textContent = JSON.stringify(
    { wide, fits, before, rising, falling, sign, all, some, fixed, ground, errors });
});
</script>"""


def chromium(folder, *options):
    flags = [
        "--headless",
        "--no-sandbox",
        "--disable-gpu",
        "--hide-scrollbars",
        f"--user-data-dir={folder / 'profile'}",
    ]
    done = subprocess.run([CHROMIUM, *flags, *options], capture_output=True, text=True, timeout=1200)
    assert done.returncode == 0, done.stderr
    return done.stdout


def frame(report, width, script=""):
    """Write a page that holds the report in a frame of that width; return its address."""
    file = report.parent / f"frame{width}.html"
    file.write_text(FRAME.format(width=width, page=html.escape(report.read_text("utf-8"))) + script, "utf-8")
    return file.as_uri()


@pytest.fixture(scope="module")
def report(tmp_path_factory):
    folder = tmp_path_factory.mktemp("looks")
    labels = [f"packet-drop/drop={d}[ticks=30]" for d in ("0", "0.3", "0.5", "0.9")] + ["trajectory"]
    rows = pd.concat([rows_of(label, MANY, bounds=(list(MANY)[2],)) for label in labels], ignore_index=True)
    return html_page.write(kept_from(rows, folder), load(), folder)


@pytest.mark.parametrize(("width", "dark"), [(400, False), (1400, True)])
def test_nothing_sticks_out_and_tables_sort_and_filter(report, width, dark):
    colours = f"--blink-settings=preferredColorScheme={0 if dark else 1}"
    address = frame(report, width, SCRIPT)
    dom = chromium(report.parent, colours, "--virtual-time-budget=5000", "--dump-dom", address)
    found = json.loads(html.unescape(re.search(r'<pre id="result">(.*?)</pre>', dom, re.DOTALL)[1]))
    assert found["errors"] == []
    assert found["wide"] <= width
    assert found["fits"] == (width == 1400)
    assert found["fixed"]
    assert found["rising"] == sorted(found["before"])
    assert found["falling"] == sorted(found["before"], reverse=True) != found["before"]
    assert "▼" in found["sign"]
    assert found["some"] == found["all"] - 5  # one estimator in five scenarios
    assert (found["ground"] == "rgb(255, 255, 255)") == (not dark)
