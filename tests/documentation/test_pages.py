"""The documentation: its examples run, its links lead somewhere, and it knows every public name."""

import re
import runpy
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest

import cooploc as cl
from cooploc.analysis.claims.kinds import KINDS
from cooploc.analysis.claims.ledger import load

ROOT = Path(__file__).resolve().parents[2]
PAGES = [*(ROOT / "docs").rglob("*.md"), ROOT / "README.md", ROOT / "CONTRIBUTING.md"]
PAGES = [page for page in PAGES if "generated" not in page.parts]
REFERENCE = ROOT / "docs/reference/python.md"


def blocks(page: Path) -> list[str]:
    """The Python of a page."""
    return re.findall(r"^```python\n(.*?)^```$", page.read_text("utf-8"), re.DOTALL | re.MULTILINE)


def links(page: Path) -> Iterator[str]:
    """The relative targets of a page's links and pictures."""
    text = re.sub(r"^```.*?^```$", "", page.read_text("utf-8"), flags=re.DOTALL | re.MULTILINE)
    for target in re.findall(r"\]\(([^)\s]+)\)", text):
        if not target.startswith(("http", "#", "mailto")):
            yield target.partition("#")[0]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_every_link_leads_to_a_file(page):
    elsewhere = ("generated/", "/actions/")  # made by sphinx, or by the host of the repository
    inside = [target for target in links(page) if not any(part in target for part in elsewhere)]
    missing = [target for target in inside if not (page.parent / target).exists()]
    assert missing == []


def test_the_reference_has_every_public_name():
    told = set(re.findall(r"^### (\w+)$", REFERENCE.read_text("utf-8"), re.MULTILINE))
    assert told == set(cl.__all__)


@pytest.mark.slow
def test_the_table_of_estimators_is_made_from_the_code():
    """A new estimator is added to it by `python docs/generated.py`."""
    page = (ROOT / "docs/reference/estimators.md").read_text("utf-8")
    (block,) = re.findall(r"<!-- estimators: .*? -->\n(.*?)\n<!-- end of estimators -->", page, re.DOTALL)
    made = runpy.run_path(str(ROOT / "docs/generated.py"))["estimators"]()
    assert set(block.splitlines()) <= set(made.splitlines())


def test_the_readings_in_which_the_claims_hold_are_those_of_the_map():
    paper, found = ((ROOT / f"reports/{name}/README.md").read_text("utf-8") for name in ("paper", "readings"))
    first = r"This\s+claim\s+holds\s+in\s+(\d+)\s+of\s+(\d+)\s+specifications"
    second = r"its\s+second,[^,]*,\s+in\s+(\d+)\s+and\s+\d+\s+of\s+(\d+)"
    for claim, said in (("1", first), ("2", second)):
        number, of = re.search(said, paper).groups()
        assert re.search(rf"\*\*{claim}\.\*\*[^*]* holds in {number} of {of} specifications", found)


def test_the_guide_on_claims_has_a_ledger_that_is_read_and_every_kind_with_what_it_needs(tmp_path):
    guide = (ROOT / "docs/how-to/claims.md").read_text("utf-8")
    (tmp_path / "mine.toml").write_text(re.search(r"```toml\n(.*?)```", guide, re.DOTALL)[1])
    assert [claim.kind for claim in load(tmp_path / "mine.toml").claims] == ["change", "consistency"]
    rows = dict(re.findall(r"^\| `(\w+)` \| .+ \| (.+) \|$", guide, re.MULTILINE))
    assert rows == {name: ", ".join(sorted(kind.needs)) for name, kind in KINDS.items()}


@pytest.mark.slow
def test_the_worlds_of_the_guide_run(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    guide = ROOT / "docs/how-to/world.md"
    labels = re.findall(r'cooploc run "(.+?)"', guide.read_text("utf-8"))
    tables = []
    runs = ("office", "dead-reckoning"), ("ice", "dead-reckoning"), ("gps", "ekf-local,gps.py:ByGps")
    for (name, estimators), text, label in zip(runs, blocks(guide), labels, strict=True):
        Path(f"{name}.py").write_text(text)
        results = cl.run_study(label, estimators=estimators, trials=1)
        assert len(results.failures) == 0
        tables.append(results.table)
    assert tables[0]["robots"].tolist() == [2, 4]
    assert tables[1]["rmse"].is_monotonic_increasing
    assert tables[2]["certificate"].iloc[1].startswith("passed: 11 of 12 checks; equivariance: it is not known")


@pytest.mark.slow
def test_the_filters_of_the_guide_keep_the_rules_and_do_what_the_page_says(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name, text in zip(("mine", "joint"), blocks(ROOT / "docs/how-to/estimator.md"), strict=True):
        Path(f"{name}.py").write_text(text)
    assert cl.check_estimator("joint.py:Joint").passed
    truth, stream = cl.simulate("robots-1-3/n=3", trials=5, ticks=50)
    errors = cl.errors(truth, cl.run(["joint.py:Joint", "ekf-joint[anchor_reading=rssi]"], stream))
    ours, error = errors.groupby("estimator", sort=False)["rmse"].mean()
    assert error == pytest.approx(ours, rel=0.1)  # which takes all readings of a tick at once
    report = cl.check_estimator("mine.py:Mine")
    assert report.ran == 12
    assert report.passed
    truth, stream = cl.simulate("robots-1-3/n=1", trials=5, ticks=50)
    errors = cl.errors(truth, cl.run(["mine.py:Mine", "mine.py:Mine[trust=1e-9]", "dead-reckoning"], stream))
    error = errors.groupby("estimator")["rmse"].mean()
    assert error["mine.py:Mine"] < 0.9 * error["dead-reckoning"]
    assert error["mine.py:Mine[trust=1e-9]"] == pytest.approx(error["dead-reckoning"], rel=1e-3)


def test_a_citation_is_of_this_version():
    version = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]["version"]
    assert f"\nversion: {version}\n" in (ROOT / "CITATION.cff").read_text("utf-8")
    assert re.search(rf"\n## \[?{version}", (ROOT / "CHANGELOG.md").read_text("utf-8"))


def test_every_number_of_a_finding_in_the_readme_stands_on_the_page_that_it_links():
    findings = re.search(r"## What was found\n(.*?)\n## ", (ROOT / "README.md").read_text("utf-8"), re.DOTALL)[1]
    items = re.findall(r"^\d\. (.*?\((?:\[[^]]+\]\([^)]+\))\))", findings, re.DOTALL | re.MULTILINE)
    assert len(items) == 6
    for item in items:
        text, page = re.match(r"(.*)\(\[[^]]+\]\((.*?)\)\)", item, re.DOTALL).groups()
        shown = (ROOT / page).read_text("utf-8")
        for number in re.findall(r"\d+\.\d+|(?<=-)\d+(?= %)|\bin \d+", text):
            assert number in shown, (number, page)


def test_contributing_names_only_files_that_exist():
    text = (ROOT / "CONTRIBUTING.md").read_text("utf-8")
    named = [word for word in re.findall(r"`([^`\s]+)`", text) if re.search(r"/|\.(py|toml|md|cff|lock)$", word)]
    assert len(named) > 40
    tops = [top for top in ROOT.iterdir() if not top.name.startswith(".") or top.name in (".ci", ".github")]
    there = [Path("log.toml"), *(path.relative_to(ROOT) for top in tops for path in (top, *top.rglob("*")))]
    assert [word for word in named if not any(path.match(word.rstrip("/")) for path in there)] == []


@pytest.mark.slow
def test_the_examples_of_the_reference_run_in_their_order(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    space = {"__name__": "example"}
    for i, block in enumerate(blocks(REFERENCE), 1):
        exec(compile(block, f"{REFERENCE.name}, example {i}", "exec"), space)  # our own page
