"""Tables for LaTeX: text escaped, the rules of booktabs, and a document that holds them all."""

LONG = 40  # rows beyond which a table runs over pages
SPECIAL = {
    "\\": r"\textbackslash{}",
    **{c: f"\\{c}" for c in "&%$#_{}"},
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    "<": r"\textless{}",
    ">": r"\textgreater{}",
    "|": r"\textbar{}",
    '"': r"\textquotedbl{}",
    "[": "{[}",  # after a line's \\ it would begin an option
    "]": "{]}",
    "–": "--",
    "µ": r"\textmu{}",
    "×": r"\texttimes{}",
    "±": r"\textpm{}",
    "·": r"\textperiodcentered{}",
    "²": r"\texttwosuperior{}",
    "✓": r"\ensuremath{\surd}",
    "✗": r"\ensuremath{\times}",
    "∞": r"\ensuremath{\infty}",
    "\n": " ",
}


def tabular(caption: str, sides: str, heads: list[str], rows: list[list[str]]) -> str:
    """A table with the rules of booktabs; a long one is a longtable."""
    head, *body = (" & ".join(map(escaped, cells)) + r" \\" for cells in [heads, *rows])
    said = rf"\caption{{{escaped(caption)}}}"
    if len(rows) > LONG:
        top = [rf"\begin{{longtable}}{{@{{}}{sides}@{{}}}}", said + r" \\", r"\toprule", head, r"\midrule"]
        repeated = [r"\endfirsthead", r"\toprule", head, r"\midrule", r"\endhead", r"\bottomrule", r"\endfoot"]
        lines = [*top, *repeated, *body, r"\end{longtable}"]
    else:
        top = [r"\begin{table}", r"\centering", said, rf"\begin{{tabular}}{{@{{}}{sides}@{{}}}}", r"\toprule"]
        lines = [*top, head, r"\midrule", *body, r"\bottomrule", r"\end{tabular}", r"\end{table}"]
    return "\n".join(lines) + "\n"


def document(names: list[str], title: str) -> str:
    """A LaTeX document of tables in files beside it."""
    packages = [
        r"\usepackage[T1]{fontenc}",
        r"\usepackage[utf8]{inputenc}",
        r"\usepackage{textcomp,booktabs,longtable}",
    ]
    paper = r"\usepackage[paperwidth=60cm,paperheight=42cm,margin=15mm]{geometry}"
    body = [rf"\input{{{name}}}" for name in names]
    start = [r"\documentclass{article}", *packages, paper, r"\begin{document}", rf"\section*{{{escaped(title)}}}"]
    return "\n".join([*start, *body, r"\end{document}"]) + "\n"


def escaped(text: str) -> str:
    """Text with what means something to LaTeX escaped, and a question mark for what its standard fonts lack."""
    return "".join(SPECIAL.get(c, c if c.isprintable() and ord(c) < 128 else _letter(c)) for c in text)


def _letter(c: str) -> str:
    return c if c.isalpha() and ord(c) < 256 else "?"
