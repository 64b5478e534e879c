"""What a paper takes from a run: figures of its columns' width, tables that fit, references that are true."""

import contextlib
import re
import shutil
import subprocess
import zlib

import matplotlib as mpl
import pandas as pd
import pytest
from made_runs import EVIL, kept_from, rows_of

from cooploc.analysis.execution.run_directory import select
from cooploc.analysis.report import paper
from cooploc.analysis.report.labels import LONGEST, short_labels
from cooploc.analysis.report.run_numbers import numbers_of
from cooploc.analysis.report.tables import read_toml
from cooploc.estimators import BUILTIN, make
from cooploc.estimators.errors import BadInput
from cooploc.estimators.registry import source_of

LONG = "mrsl-rssi[particles=500,anchor_reading=rssi]"
TEAM = {"arl": (1.0, 1.0), LONG: (0.5, 1.1), f"a/b/{EVIL}[x=1]": (0.8, 9.0), "ekf-joint": (0.2, 1.0)}
COLUMNS = ("rmse", "change", "anees", "bytes")
WIDE = ("rmse", "change", "anees", "coverage95", "bytes", "seconds")


@pytest.fixture(scope="module")
def kept(tmp_path_factory):
    labels = [f"packet-drop/drop={d}[ticks=8]" for d in (0, 0.5, 0.9)] + ["nlos[ticks=8]", f"{EVIL}/{'long,' * 30}"]
    rows = pd.concat([rows_of(label, TEAM, bounds=("ekf-joint",)) for label in labels], ignore_index=True)
    return kept_from(rows, tmp_path_factory.mktemp("paper"), name=EVIL)


@pytest.fixture(scope="module")
def written(kept):
    paper.write(kept, kept.folder / "paper", COLUMNS, everything=True)
    return kept.folder / "paper"


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("pdflatex") is None, reason="no LaTeX is installed")
def test_every_figure_and_table_fits_a_two_column_paper(written, kept):
    more = paper.write(select(kept, scenarios=["nlos[ticks=8]"]), kept.folder / "wide", WIDE)
    assert any(r"\begin{table*}" in file.read_text() for file in more if file.parent.name == "tables")
    for folder in (written, kept.folder / "wide"):
        command = ["pdflatex", "-interaction=nonstopmode", "-halt-on-error", paper.EXAMPLE]
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, errors="replace")
        assert done.returncode == 0, done.stdout[-2000:]
        assert re.findall(r"Overfull.*|Float too large.*|Reference.*undefined on input.*", done.stdout) == []
        assert all(file.name in done.stdout.replace("\n", "") for file in (folder / "figures").glob("*.pdf"))


@pytest.mark.slow
def test_what_a_user_sets_in_matplotlib_changes_no_file(kept):
    one = select(kept, scenarios=["nlos[ticks=8]"])
    paper.write(one, kept.folder / "plain")
    with mpl.rc_context({"text.usetex": True, "font.size": 30, "lines.linewidth": 9}):
        paper.write(one, kept.folder / "set")
    for file in sorted((kept.folder / "plain" / "figures").iterdir()):
        assert file.read_bytes() == (kept.folder / "set" / "figures" / file.name).read_bytes(), file.name


def streams_of(body):
    """Yield the packed parts of a PDF file that can be unpacked."""
    for part in re.findall(rb"stream\r?\n(.*?)endstream", body, re.DOTALL):
        with contextlib.suppress(zlib.error):
            yield zlib.decompress(part)


@pytest.mark.slow
def test_figures_have_the_width_of_a_column_or_of_two_and_their_fonts_within(written):
    files = sorted((written / "figures").glob("*.pdf"))
    names = {file.stem for file in files}
    assert names == {file.stem for file in (written / "figures").glob("*.svg")}
    assert {"one-packet-drop-ticks-8-drop-1col", "one-rmse-nlos-ticks-8-1col", "one-anees-nlos-ticks-8-1col"} <= names
    assert "one-anees-bytes-seconds-nlos-ticks-8-2col" in names
    for file in files:
        body = file.read_bytes()
        left, _, right, _ = map(float, re.search(rb"/MediaBox \[ ([\d. ]+) \]", body)[1].split())
        assert (right - left) / 72 == pytest.approx(3.48 if file.stem.endswith("1col") else 7.14, abs=0.01)
        fonts = b"".join(streams_of(body)) + body
        assert b"/FontFile2" in fonts
        assert b"/Type3" not in fonts
        assert b"<text" not in file.with_suffix(".svg").read_bytes()


@pytest.mark.slow
def test_the_tables_have_every_scenario_and_what_explains_them(written):
    latex = "".join(file.read_text() for file in (written / "tables").iterdir())
    for word in (r"\toprule", r"\label{tab:one", "mrsl-rssi {[}a{]}", "anchor", "RMSE {[}m{]}", "change", "seed 3"):
        assert word in latex
    assert latex.count("drop=0.9") == 1
    assert latex.count(r"\textsuperscript{o}") > 1  # who is over-confident, and what that means


@pytest.mark.slow
def test_what_does_not_fit_or_is_unknown_is_said(kept):
    with pytest.raises(BadInput, match="no column 'rsme'; did you mean 'rmse'"):
        paper.write(kept, kept.folder / "no", ["rsme"])
    with pytest.raises(BadInput, match="no figure 'anes'; did you mean 'anees'"):
        paper.write(kept, kept.folder / "no", figures=["anes"])
    assert list(select(kept, scenarios=["packet-drop"]).manifest["cells"]) == list(kept.manifest["cells"])[:3]
    own = kept._replace(
        manifest={**kept.manifest, "cells": {**kept.manifest["cells"], "nlos": kept.manifest["cells"]["nlos[ticks=8]"]}}
    )
    assert list(select(own, scenarios=["nlos"]).manifest["cells"]) == ["nlos"]
    with pytest.raises(BadInput, match=r"no scenario 'nlos\[ticks=9\]'; did you mean 'nlos"):
        select(kept, scenarios=["nlos[ticks=9]"])


@pytest.mark.slow
def test_by_default_three_figures_and_one_table_are_written_in_the_order_of_a_paper(kept):
    part = select(kept, ["arl", LONG], ["nlos[ticks=8]"], baseline=LONG)
    paper.write(part, kept.folder / "few")
    latex = (kept.folder / "few" / paper.EXAMPLE).read_text()
    assert re.findall(r"\\includegraphics{(.*?)}|\\input{(.*?)}", latex) == [
        ("rmse", ""), ("anees", ""), ("bytes", ""), ("", "tables/one")
    ]  # fmt: skip
    assert latex.count("nothing was run; 8 trials a scenario") == 3
    table = (kept.folder / "few" / "tables" / "one.tex").read_text()
    assert r"arl~\cite{parashar2020}" in table
    cited = re.findall(r"\\cite{(.*?)}", table)
    assert set(cited) <= set(re.findall(r"@\w+{(\w+),", (kept.folder / "few" / "estimators.bib").read_text()))
    assert "Change of the RMSE against mrsl-rssi" in table
    assert "ekf-joint" not in table


def test_a_long_label_is_short_and_equal_settings_have_equal_letters():
    long = "particles=500,anchor_reading=rssi"
    names = ["arl", "arl[K=1]", f"mrsl-rssi[{long}]", f"rssi-pf[{long}]", "mrsl-rssi[particles=900,M=1]"]
    names += ["my/f.py:F", "my/g.py:G[a=1]"]
    found = short_labels(names)
    shown = ["arl", "arl[K=1]", "mrsl-rssi [a]", "rssi-pf [a]", "mrsl-rssi [b]", "f.py:F", "g.py:G[a=1]"]
    assert [*found.short.values()] == shown
    assert found.legend(names[:3]) == ["[a] particles=500, anchor_reading=rssi"]
    assert len("arl[K=1]") <= LONGEST < len(names[2])
    two = ["old/f.py:F", "new/f.py:F[a=1]"]
    assert [*short_labels(two).short.values()] == two

    label = "mrsl-rssi[density=exact,M=1,K=3]"
    assert short_labels([label], {"consistent": "K=3, density=exact,M=1"}).shorten(label) == "mrsl-rssi [consistent]"


def test_a_study_that_includes_another_has_its_names_of_parameters(tmp_path):
    rows = rows_of("nlos[ticks=8]", {"arl": (1.0, 1.0), LONG: (0.5, 1.1)})
    block = {"variants": {"raw": LONG.partition("[")[2].removesuffix("]")}}
    assert numbers_of(kept_from(rows, tmp_path, also=[block])).names.shorten(LONG) == "mrsl-rssi [raw]"


@pytest.mark.parametrize("name", [name for name in BUILTIN if paper.source_keys(name)])
def test_the_bibliography_has_the_source_that_an_estimator_names(name):
    source = source_of(type(make(name)))
    first = read_toml(paper.SOURCES)[paper.source_keys(name)[0]]
    assert str(first["year"]) in source
    for author in first["author"].split(" and "):
        family = re.sub(r"{\\\W(\w)}", r"\1", author.partition(",")[0])  # without accents
        assert family in source, family
    assert re.sub(r"[{}]", "", first["title"]).casefold() in source.casefold()


def test_the_bibliography_of_a_run_holds_what_it_used_and_no_more():
    found = paper.bibtex(["ekf-luft[gate=9]", "mine.py:Filter"], ["mrclam/all"])
    assert re.findall(r"@\w+{(\w+),", found) == ["cooploc", "luft2018", "leung2011"]
    assert "% mine.py:Filter is not built in: add its source" in found
    assert found.count("{") == found.count("}")
    known = {name for source in read_toml(paper.SOURCES).values() for name in source.get("estimators", ())}
    assert known <= set(BUILTIN)


def test_a_table_is_no_longer_than_a_page():
    pages = paper.pages_of([f"s{i // 20}" for i in range(200)])
    assert [row for page in pages for row in page] == list(range(200))
    assert max(map(len, pages)) < paper.LINES


def test_a_negative_number_has_the_minus_of_formulas_wherever_it_stands():
    cells = ["[-67, -50]", "-14", "robots-1-3/n=1", "2e-05"]
    assert list(map(paper.tex, cells)) == ["{[}$-$67, $-$50{]}", "$-$14", "robots-1-3/n=1", "2e-05"]
