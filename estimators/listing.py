"""The table of estimators, `cl.list_estimators()`, and the configurations of a method that have a name.

*Preset*: our reading of its paper, the default. *Letter*: the reading nearest to the seed paper's words; *code*: what
public code of companion work does (both as in the ledger of its claims). *At its best*: of the same method and
readings, the smallest error of those tried in 40 trials of `robots-1-3/n=3` and `packet-drop/drop=0.7`.
"""

from dataclasses import replace
from functools import cache
from typing import TYPE_CHECKING, NamedTuple

from cooploc.estimators import configure, make, names, plugin_errors
from cooploc.estimators.errors import BadInput
from cooploc.estimators.label_syntax import parse
from cooploc.estimators.registry import source_of, traits

if TYPE_CHECKING:
    from pandas import DataFrame

ONCE = "density=exact,M=1,K=1"  # every direction is used once, with its exact density
HOW = ("engine", "weights")  # parameters of how a result is computed, not of what it is


LETTER = "point=max,proposal=box,residual=sum,temper=false"
CODE = "box=0.1,point=max,proposal=best,residual=code"
READ = {  # parameters of the methods of the seed paper, to its letter
    "arl": LETTER,
    **dict.fromkeys(("mrsl-rssi", "mrsl-distance"), f"{LETTER},neighbours=exact,neighbour_samples=M"),
    "ctrn": f"{LETTER},fusion=received",
}


class Configurations(NamedTuple):
    """The labels of a method nearest to the words of its own paper, and at its best."""

    published: str
    best: str


KNOWN = {
    **{name: Configurations(name, f"{name}[{ONCE}]") for name in ("arl", "mrsl-rssi", "mrsl-distance", "channel-pf")},
    "cmrl": Configurations("cmrl", f"cmrl[{ONCE},apart=1]"),
    "reciprocal-pf": Configurations("reciprocal-pf", f"reciprocal-pf[{ONCE},report=before]"),
    # received beliefs are nearest to the paper's words on it; the default fuses moments
    "ctrn": Configurations("ctrn[fusion=received]", f"ctrn[{ONCE},fusion=received]"),
}


def configurations(name: str) -> Configurations:
    """Return the two configurations of a method, by its name."""
    return KNOWN.get(name, Configurations(name, name))


@cache
def setting_kind(label: str) -> str:
    """Return "preset", "letter", "code" or "at its best"; empty where it is none, or the method has only one."""
    name = parse(label)[0]
    if name not in KNOWN:
        return ""
    try:
        made = make(label)
    except BadInput:
        return ""
    named = {"preset": name, "at its best": KNOWN[name].best}
    if name in READ:
        named |= {"letter": f"{name}[{READ[name]}]", "code": f"{name}[{CODE}]"}
    for word, which in named.items():
        other = make(which)
        how = {key: getattr(other, key) for key in HOW if hasattr(other, key)}
        if replace(made, **how) == other:
            return word
    return ""


@cache
def declares_bytes(label: str) -> bool:
    """Return whether a built-in estimator holds the whole team and states its own traffic."""
    try:
        asked = configure(label)
        return asked.builtin and traits(make(asked)).team
    except BadInput:
        return False


def list_estimators() -> "DataFrame":
    """Return a table with a row for each estimator that can be named, the built-in ones first.

    Columns: `name`; `about`, in a sentence; `uses`, the channels it needs; `centralised`, whether all readings reach
    one computer; `bound`, whether it bounds all others; `offline`, whether it sees later readings too; `published` and
    `best`, its configurations; `source`, the paper; `problem`, why a plug-in cannot be used, empty where it can.
    """
    from pandas import DataFrame

    rows, problems = [], plugin_errors()
    for name in names():
        if name not in problems:
            made = make(name)
            has, about = traits(made), (type(made).__doc__ or "").strip().partition("\n")[0]
            flags = has.centralised, has.bound, has.offline
            rows.append((name, about, ", ".join(made.uses), *flags, *configurations(name), source_of(type(made)), ""))
    rows += [(name, "", "", *(False,) * 3, "", "", "", reason) for name, reason in problems.items()]
    columns = "name about uses centralised bound offline published best source problem"
    return DataFrame(rows, columns=columns.split())
