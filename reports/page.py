"""Writes a page of a text in reports/text and of runs, so that no number of it is typed by hand.

Run: python reports/page.py TEXT RUNS OUT [--data DIR] [--draft]. RUNS is the folder of the run directories, each with
the name of its study. A text takes its numbers from `study("NAME")` (study_numbers.py), and from the module of its own
name, which also draws its figures. `{{ require(holds, "...") }}` stops where the run shows something else; a draft
only marks it. Where OUT has the lines `<!-- TEXT: ... -->` and `<!-- end of TEXT -->`, what is between them is written.
"""

import os
import re
import shutil
import subprocess
import sys
import tempfile
from argparse import ArgumentParser
from functools import cache, partial
from importlib import import_module
from pathlib import Path

import matplotlib as mpl
import pandas as pd
import study_numbers
from jinja2 import Environment, FileSystemLoader, StrictUndefined, TemplateError

from cooploc.analysis import formats
from cooploc.estimators.errors import BadInput, count_of

REPORTS = Path(__file__).resolve().parent
TEXTS = REPORTS / "text"
MODULES = {"fusion", "information", "paper", "readings", "real-robots", "tuned"}  # texts with a module of their name


def require(holds: bool, what: str, draft: bool = False) -> str:
    """Return nothing where it holds; elsewhere stop the page, or mark the place in a draft."""
    if holds or draft:
        return "" if holds else f"[NOT SHOWN: {what}] "
    raise BadInput(f"the runs do not show that {what}; rewrite the sentence in reports/text")


def escape_tex(text: object) -> str:
    """Return a text for LaTeX: what has a meaning there escaped, with minus signs and thin spaces."""
    escaped = re.sub(r"([%_&#$])", r"\\\1", str(text)).replace(r" \%", r"\,\%")
    return re.sub(r"(?<!\w)-(?=\d)", "$-$", escaped)


def render(name: str, runs: str | Path, out: str | Path = "page.md", data: str = "", draft: bool = False) -> str:
    """Return a text of reports/text (with `.j2`, or without `.md.j2`) with its numbers; draw figures beside `out`."""
    runs, out = Path(runs), Path(out)
    texts = Environment(
        loader=FileSystemLoader(TEXTS), undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True,
        keep_trailing_newline=True, autoescape=False,
    )  # fmt: skip
    texts.globals.update(
        **{name: getattr(study_numbers, name) for name in ("claims", "in_letter", "in_reading", "measured")},
        links=Path(os.path.relpath(REPORTS, out.resolve().parent)).as_posix(),
        study=cache(lambda study: study_numbers.StudyRun(runs / study)),
        tuned=cache(lambda study: study_numbers.order_when_tuned(runs / study)),
        preset_verdicts=lambda study: study_numbers.preset_verdicts(runs / study),
        decided_by_more_trials=lambda study: study_numbers.decided_by_more_trials(runs / study),
        require=partial(require, draft=draft),
        form=formats,
        **{word.__name__: word for word in (count_of, formats.interval, formats.join_words)},
    )
    texts.filters.update(tex=escape_tex)
    values = import_module(name.replace("-", "_")).values(runs, out.parent, Path(data)) if name in MODULES else {}
    text = texts.get_template(name if name.endswith(".j2") else f"{name}.md.j2").render(values)
    return text if name.endswith(".tex.j2") else tidy(text)


def tidy(text: str) -> str:
    """Return a text without the blank lines and spaces that its statements leave."""
    return re.sub(r"\n{3,}", "\n\n", re.sub(r"[ \t]+$", "", text.strip("\n"), flags=re.MULTILINE)) + "\n"


def put_between(page: str, name: str, text: str) -> str:
    """Return a page with a text between the marks of a name; nothing where there are none."""
    marks = re.compile(rf"(<!-- {name}(?:: [^\n]*)? -->\n).*?(\n<!-- end of {name} -->)", re.DOTALL)
    return marks.sub(lambda found: f"{found[1]}{text}{found[2]}", page) if marks.search(page) else ""


def pipe(frame: pd.DataFrame) -> str:
    """Return a pipe table of texts."""
    lines = [frame.columns, ["---"] * len(frame.columns), *frame.itertuples(index=False)]
    return "\n".join(f"| {' | '.join(map(str, cells))} |" for cells in lines)


def pipe_by_scenario(table: pd.DataFrame, texts: list[str]) -> str:
    """Return a pipe table of texts, a row for each estimator and a column for each scenario, in order."""
    wide = table.assign(text=texts).pivot(index="estimator", columns="scenario", values="text")
    ordered = wide.reindex(index=table["estimator"].unique(), columns=table["scenario"].unique())
    return pipe(ordered.fillna("").reset_index())


def write_pdf(text: str, out: Path) -> None:
    """Write a PDF of LaTeX, with the map of the readings as its figure."""
    if not (latex := shutil.which("pdflatex")):
        raise BadInput("pdflatex is not there; apt-get install texlive-publishers")
    with tempfile.TemporaryDirectory() as scratch:
        (Path(scratch) / "page.tex").write_text(text, encoding="utf-8")
        import_module("readings").draw_map(Path(scratch) / "map.pdf")
        command = [latex, "-interaction=nonstopmode", "-halt-on-error", "page.tex"]
        for _ in range(2):  # the second time with the numbers of the tables
            done = subprocess.run(command, cwd=scratch, capture_output=True, text=True, check=False)
        if done.returncode:
            lines = [line for line in done.stdout.splitlines() if line.startswith("!")]
            raise BadInput(f"pdflatex ended with {done.returncode}: {lines[:1]}; correct the text")
        shutil.copy(Path(scratch) / "page.pdf", out)


def main(arguments: list[str] | None = None) -> int:
    """Write a page; where the runs do not bear it, one line that says so."""
    mpl.use("agg")
    parser = ArgumentParser(description=(__doc__ or "").split("\n")[0])
    for name in ("text", "runs", "out"):
        parser.add_argument(name)
    parser.add_argument("--data", default=os.environ.get("COOPLOC_DATA", "../shared/data"), help="folder of recordings")
    parser.add_argument("--draft", action="store_true", help="mark what the runs do not show")
    asked = parser.parse_args(arguments)
    try:
        text, page = render(asked.text, asked.runs, asked.out, asked.data, asked.draft), Path(asked.out)
        if page.suffix == ".pdf":
            write_pdf(text, page)
        else:
            before = page.read_text(encoding="utf-8") if page.exists() else ""
            page.write_text(put_between(before, asked.text, text) or text, encoding="utf-8")
    except (BadInput, TemplateError) as error:
        print(f"reports/text/{asked.text}: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
