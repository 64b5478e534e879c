"""The texts of reports/text, the numbers that runs put into them, and the steps that make both."""

import importlib
import re
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

import cooploc as cl
from cooploc.estimators.errors import BadInput

REPORTS = Path(__file__).resolve().parents[3] / "reports"
TEXTS = sorted((REPORTS / "text").glob("*.j2"))
WHERE = "robots-1-3/n=2[ticks=4]"
TEXT = f"""{{% set error = study("short").rmse("arl", "{WHERE}") %}}
# A title

{{{{ require(error.value < LIMIT, "it is small") -}}}}
- Words that are {{{{ error.alone }}}}
"""


@pytest.fixture(scope="module")
def scripts():
    sys.path.insert(0, str(REPORTS))
    yield {name: importlib.import_module(name) for name in ("study_numbers", "page", "make_all")}
    sys.path.remove(str(REPORTS))


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    folder = tmp_path_factory.mktemp("runs")
    (folder / "short.toml").write_text(f'trials = 6\nscenarios = ["{WHERE}"]\nestimators = ["arl", "rssi-pf"]\n')
    cl.run_study(folder / "short.toml", out=folder / "short")
    return folder


def test_numbers_are_those_of_compare_and_what_was_not_run_is_named_with_the_nearest_that_was(scripts, runs):
    run = scripts["study_numbers"].StudyRun(runs / "short")
    table = cl.compare(run.stored.rows, baseline="arl").set_index("estimator")
    change, rmse = run.change("rssi-pf", "arl", WHERE), run.rmse("arl", WHERE)
    assert change[:3] == tuple(table.loc["rssi-pf", ["change", "change_low", "change_high"]])
    assert rmse[:3] == tuple(table.loc["arl", ["rmse", "rmse_low", "rmse_high"]])
    assert run.trials == "6"
    with pytest.raises(BadInput, match=r"no 'alr' in .*did you mean 'arl'"):
        run.rmse("alr", WHERE)
    with pytest.raises(BadInput, match="no scenario 'nlos'"):
        run.change("arl", "rssi-pf", "nlos")
    number = scripts["study_numbers"].Number(-0.204, -0.26, -0.138)
    assert (str(number), number.inside) == ("-20 % (-26 to -14)", "-20 %, -26 to -14")
    assert (number.falls, number.rises, number.open) == (True, False, False)


@pytest.fixture
def texts(scripts, tmp_path, monkeypatch):
    monkeypatch.setattr(scripts["page"], "TEXTS", tmp_path)
    for name, limit in (("true", "1e9"), ("false", "0")):
        (tmp_path / f"{name}.md.j2").write_text(TEXT.replace("LIMIT", limit), "utf-8")
    return scripts["page"]


def test_a_sentence_that_the_run_does_not_bear_stops_the_page_with_one_line(texts, runs, tmp_path, capsys):
    page = tmp_path / "out.md"
    assert texts.main(["false", str(runs), str(page)]) == 1
    assert not page.exists()
    assert capsys.readouterr().err.splitlines() == [
        "reports/text/false: the runs do not show that it is small; rewrite the sentence in reports/text"
    ]
    assert texts.main(["false", str(runs), str(page), "--draft"]) == 0
    assert "[NOT SHOWN: it is small]" in page.read_text()


def test_only_what_is_between_the_marks_of_a_page_is_written_and_with_links_from_there(texts, runs, tmp_path):
    page = tmp_path / "README.md"
    page.write_text("before\n<!-- true: how -->\nold\n\nold\n<!-- end of true -->\nafter\n", "utf-8")
    assert texts.main(["true", str(runs), str(page)]) == 0
    before, _, rest = page.read_text("utf-8").partition("<!-- true: how -->\n")
    text, _, after = rest.partition("\n<!-- end of true -->")
    assert (before, text, after) == ("before\n", texts.render("true", runs), "\nafter\n")
    assert text.startswith("# A title\n\n- Words that are ")
    (tmp_path / "linked.md.j2").write_text("[fusion]({{ links }}/fusion.md)", "utf-8")
    for name, path in (("README.md", "reports"), ("reports/paper/README.md", "..")):
        assert texts.render("linked", runs, REPORTS.parent / name) == f"[fusion]({path}/fusion.md)\n"


@pytest.mark.parametrize("text", TEXTS, ids=lambda path: path.name)
def test_every_run_of_a_text_is_made_before_its_page(scripts, text):
    names = [step.name for step in scripts["make_all"].STEPS]
    assert len(names) == len(set(names))
    name = text.name if text.name.endswith(".tex.j2") else text.name.removesuffix(".md.j2")
    (page,) = [step for step in scripts["make_all"].STEPS if step.command[2:3] == (name,)]
    asked = set(re.findall(r'(?:study|tuned|decided_by_more_trials)\("([^"]+)"\)', text.read_text("utf-8")))
    module = REPORTS / f"{name.replace('-', '_')}.py"
    asked |= set(re.findall(r'runs / "([^"]+)"', module.read_text("utf-8"))) if module.exists() else set()
    assert asked <= set(names[: names.index(page.name)])


def test_every_study_that_is_run_is_shipped_or_a_file_beside_its_page(scripts):
    shipped = set(cl.list_studies()["name"])
    runs = [step.command[step.command.index("run") + 1] for step in scripts["make_all"].STEPS if "run" in step.command]
    assert all(run in shipped or Path(run).is_file() for run in runs)


@pytest.mark.parametrize(
    ("writes", "ended"), [("pass", "failed"), ("open(sys.argv[2], 'w')", "with trials that failed")]
)
def test_a_run_that_crashed_is_not_one_whose_trials_failed(scripts, tmp_path, writes, ended):
    (tmp_path / "mine").mkdir()
    code = f"import sys; {writes}; sys.exit(1)"  # both end with 1
    command = (sys.executable, "-c", code, "run", str(tmp_path / "mine" / "table.csv"))
    asked = SimpleNamespace(runs=tmp_path, data=tmp_path, jobs=1)
    assert scripts["make_all"].run_step(scripts["make_all"].Step("mine", command), asked)[-1] == ended


@pytest.mark.slow
def test_a_page_of_a_module_is_written_with_its_sentences_and_its_figures(scripts, tmp_path):
    worlds = {"information": '"scalability/n={1,2}[ticks=6]"', "sensitivity": '"robots-1-3/n=2[ticks={4,8}]"'}
    for name, scenarios in worlds.items():
        study = f'trials = 6\nscenarios = [{scenarios}]\nestimators = ["arl", "ekf-local"]\n'
        (tmp_path / f"{name}.toml").write_text(study)
        cl.run_study(tmp_path / f"{name}.toml", out=tmp_path / name)
    cl.run_study("sightings", trials=2, out=tmp_path / "sightings")
    text = scripts["page"].render("information", tmp_path, tmp_path / "page.md", draft=True)
    for words in (
        "- **2 robots with the direction of arrival.**",
        "Alone they err by",
        "By paired intervals, ",
        "6 trials, seed 1",
    ):
        assert words in text
    for name in worlds:
        assert "</svg>" in (tmp_path / f"{name}.svg").read_text("utf-8")
