"""An example of a two-column paper that includes every figure and table of a run, to look at and to copy from."""

from typing import NamedTuple

from cooploc.analysis.paper.tables import Placed, breakable
from cooploc.analysis.report.latex import escaped

START = r"""\IfFileExists{IEEEtran.cls}{\documentclass[journal]{IEEEtran}}{%
\documentclass[twocolumn]{article}\usepackage[letterpaper,textwidth=7.16in,textheight=9.4in,columnsep=0.16in]{geometry}}
\usepackage[T1]{fontenc}
\usepackage[utf8]{inputenc}
\usepackage{textcomp,booktabs,graphicx}
\graphicspath{{figures/}}
\begin{document}"""
END = r"""\nocite{*}
\IfFileExists{IEEEtran.bst}{\bibliographystyle{IEEEtran}}{\bibliographystyle{plain}}
\bibliography{estimators}
\end{document}"""
WAITING = 6  # floats, after which a page is begun; LaTeX keeps eighteen


class Included(NamedTuple):
    """A figure in files of its own."""

    name: str
    caption: str
    columns: int  # of the paper that it is wide


def document(title: str, figures: list[Included], tables: list[Placed]) -> str:
    """The text of the document; each figure stands in its own size, so that its letters have theirs."""
    floats = [*map(_figure, figures), *(rf"\input{{tables/{one.name}}}" for one in tables)]
    lines = [START, rf"\section*{{{escaped(title)}}}"]
    for number, one in enumerate(floats, 1):
        lines += [one, *([r"\clearpage"] if number % WAITING == 0 else [])]
    return "\n".join([*lines, END]) + "\n"


def _figure(one: Included) -> str:
    name = "figure" + "*" * (one.columns == 2)
    lines = [
        rf"\begin{{{name}}}[!t]",
        r"\centering",
        rf"\includegraphics{{{one.name}}}",
        rf"\caption{{{breakable(one.caption)}}}",
        rf"\label{{fig:{one.name}}}",
        rf"\end{{{name}}}",
    ]
    return "\n".join(lines)
