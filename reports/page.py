"""Writes a page of a text in reports/text and of runs, so that no number of it is typed by hand.

Run: python reports/page.py TEXT RUNS OUT [draft], as in `python reports/page.py gbp build/reports reports/gbp.md`. RUNS
is the folder of the run directories, each with the name of its study. A text takes its numbers from `told("STUDY")`
(see told.py), and says what must hold for its words: `{{ shown(change.falls, "...") }}` writes nothing, and stops where
the run shows something else, so that the sentence is rewritten. A draft, of runs of few trials, only marks it.
Where OUT has the lines `<!-- TEXT: ... -->` and `<!-- end of TEXT -->`, only what is between them is written.
"""

import os
import re
import sys
import textwrap
from functools import cache
from pathlib import Path

from jinja2 import Environment, FileSystemLoader, StrictUndefined, TemplateError
from speeds import measured_on, speed
from told import Told, claims, in_letter, order_when_tuned, verdicts_then_and_now

from cooploc.analysis.formats import listed
from cooploc.estimators.plugins.errors import BadInput

REPORTS = Path(__file__).resolve().parent
TEXTS = REPORTS / "text"
AS_IT_IS = re.compile(r"[#|!`]|    ")  # begins a heading, a table, a figure, code
ITEM = re.compile(r"(?:-|\d+\.) ")  # begins an item of a list
WRAPPER = textwrap.TextWrapper(118, break_long_words=False, break_on_hyphens=False)


def shown(holds: bool, what: str) -> str:
    """Nothing, where it holds."""
    if not holds:
        raise BadInput(f"the runs do not show that {what}; rewrite the sentence in reports/text")
    return ""


def tex(text: object) -> str:
    """For LaTeX: what has a meaning there escaped, with minus signs and thin spaces."""
    escaped = re.sub(r"([%_&#$])", r"\\\1", str(text)).replace(r" \%", r"\,\%")
    return re.sub(r"(?<!\w)-(?=\d)", "$-$", escaped)


def marked(holds: bool, what: str) -> str:
    """A mark, where it does not hold."""
    return "" if holds else f"[NOT SHOWN: {what}] "


def written(name: str, runs: str | Path, draft: bool = False, links: str = "..") -> str:
    """A text with its numbers.

    Args:
        name: of a file in reports/text, with `.j2` or without `.md.j2`.
        runs: folder of the run directories.
        draft: whether a sentence that does not hold is marked, instead of refused.
        links: how the folder of the reports is reached from the page, for what is included in several.

    Raises:
        BadInput: the runs have no such number, or do not show what a sentence says.

    """
    told = cache(lambda study: Told(Path(runs) / study))
    texts = Environment(
        loader=FileSystemLoader(TEXTS), undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True,
        keep_trailing_newline=True, autoescape=False,
    )  # fmt: skip
    tuned = cache(lambda study: order_when_tuned(Path(runs) / study))
    texts.globals.update(
        links=links,
        told=told,
        tuned=tuned,
        claims=claims,
        in_letter=in_letter,
        speed=speed,
        measured_on=measured_on,
        verdicts_then_and_now=verdicts_then_and_now,
        shown=marked if draft else shown,
        listed=listed,
    )
    texts.filters.update(tex=tex)
    text = texts.get_template(name if name.endswith(".j2") else f"{name}.md.j2").render()
    return text if name.endswith(".tex.j2") else folded(text)


def folded(text: str) -> str:
    """With paragraphs and items of lists folded at 120 letters; tables, code, headings and figures stay."""
    blocks = re.split(r"\n\s*\n", re.sub(r" +$", "", text.strip("\n"), flags=re.MULTILINE))
    return "\n\n".join(block if AS_IT_IS.match(block) else _paragraph(block) for block in blocks) + "\n"


def _paragraph(block: str) -> str:
    return "\n".join(_item(item) for item in re.split(rf"\n(?={ITEM.pattern})", block))


def _item(item: str) -> str:
    """Folded, with what follows its first line below its first word."""
    mark = ITEM.match(item)
    WRAPPER.subsequent_indent = " " * len(mark[0]) if mark else ""
    return WRAPPER.fill(" ".join(item.split()))


def links_of(page: Path) -> str:
    """How the folder of the reports is reached from a page."""
    return Path(os.path.relpath(REPORTS, page.resolve().parent)).as_posix()


def _between(page: Path, name: str, text: str) -> str:
    """The page with a text between its marks; nothing where there are none."""
    before = page.read_text(encoding="utf-8") if page.exists() else ""
    marks = re.compile(rf"(<!-- {name}: [^\n]* -->\n).*?(\n<!-- end of {name} -->)", re.DOTALL)
    return marks.sub(lambda found: f"{found[1]}{text}{found[2]}", before) if marks.search(before) else ""


def main(name: str, runs: str, out: str, draft: str = "") -> int:
    """Write a page; where the runs do not bear it, one line that says so."""
    try:
        text, page = written(name, runs, bool(draft), links_of(Path(out))), Path(out)
        page.write_text(_between(page, name, text) or text, encoding="utf-8")
    except (BadInput, TemplateError) as error:
        print(f"reports/text/{name}: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
