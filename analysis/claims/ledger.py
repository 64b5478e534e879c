"""A ledger: what a paper claims, as a TOML file that says where each claim is to be looked for.

    paper = "A. Author, Title, 2022"

    [[claims]]
    id = "1"
    says = "Ours is a third better than theirs"
    kind = "change"
    of = "mrsl-rssi"
    than = "ctrn"
    scenarios = "robots-1-3/n=3"
    size = -0.33  # a change b/a - 1 of the error: negative where it falls

`kinds.KINDS` says which keys each kind of claim takes, what they mean, and how it is judged. A scenario
`scalability/n={3..99}` stands for all those of the run whose value lies between the two. `[variants.NAME]` maps
scenarios or estimators to others, so that a claim is judged again where the paper can be read in another way;
`[dimensions.NAME]` states one thing that can be read in several ways, and `multiverse` judges over all of them.
"""

import tomllib
from importlib.resources import files
from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, Field, ValidationError

from cooploc.analysis.claims.interpretations import Choice, Dimension, find_error
from cooploc.analysis.claims.kinds import KINDS, RELATIVE, STRICT, Claim
from cooploc.estimators import nearest
from cooploc.estimators.errors import BadInput, plain_words
from cooploc.scenarios.display import list_table

BASE = "paper"  # the variant without substitutions
ALWAYS = {"id", "says", "where", "quote", "kind", "open"}  # keys of every kind


class Variant(BaseModel):
    """Another reading of the paper, as substitutions."""

    model_config = STRICT

    about: str = ""
    estimators: dict[str, str] = {}
    scenarios: dict[str, str] = {}


class Ledger(BaseModel):
    """A ledger's file."""

    model_config = STRICT

    paper: str
    claims: Annotated[tuple[Claim, ...], Field(min_length=1)]
    variants: dict[str, Variant] = {}
    dimensions: dict[str, Dimension] = {}  # in which the paper can be read in several ways

    def __repr__(self) -> str:
        return f"Ledger({self.paper!r}, {len(self.claims)} claims, {len(self.variants)} variants)"

    def _repr_html_(self) -> str:
        return list_table(("claim", "says", "where"), self.paper, [(c.id, c.says, c.where) for c in self.claims])


def load(path: str | Path | None = None) -> Ledger:
    """Read the ledger of a TOML file; without a path, that of Latif & Parasuraman (2022).

    Raises:
        BadInput: there is no such file, or it is not a ledger; names the claim and the key.

    """
    file: Any = files(__package__) / "claims.toml" if path is None else Path(path)
    try:
        content = tomllib.loads(file.read_text(encoding="utf-8"))
    except OSError as e:
        raise BadInput(f"the ledger {path} cannot be read: {e.strerror}; name a TOML file") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as e:
        raise BadInput(f"{path} is not a TOML file: {e}") from None
    return read(content, str(path or "claims.toml"))


def read(content: dict[str, Any], where: str) -> Ledger:
    """Return the ledger that the content of a file describes.

    Raises:
        BadInput: an unknown key, a value that does not fit, or a key that the claim's kind needs or does not use.

    """
    try:
        ledger = Ledger(**content)
    except ValidationError as e:
        raise BadInput(f"{where}{_explain(e, content)}") from None
    names = [claim.id for claim in ledger.claims]
    for claim in ledger.claims:
        if wrong := _error_of_claim(claim, names.count(claim.id)):
            raise BadInput(f"{where}, claim {claim.id!r}: {wrong}")
    if BASE in ledger.variants:
        raise BadInput(f"{where}: a variant cannot be called {BASE!r}, as the claims as they stand are: rename it")
    if wrong := find_error(ledger.dimensions, ledger.claims):
        raise BadInput(f"{where}, {wrong}")
    return ledger


def variants(claim: Claim, ledger: Ledger) -> list[tuple[str, Claim]]:
    """Return the claim as it stands, and again for every variant that changes it.

    A variant replaces all of a claim's scenarios or none, for a comparison between two kinds of worlds would say
    nothing about either; of its estimators it replaces those it names.
    """
    out = [(BASE, claim)]
    for name, variant in ledger.variants.items():
        if variant.scenarios and not all(label in variant.scenarios for label in claim.scenarios):
            continue
        changes = {
            "of": tuple(variant.estimators.get(label, label) for label in claim.of),
            "than": tuple(variant.estimators.get(label, label) for label in claim.than),
            "scenarios": tuple(variant.scenarios.get(label, label) for label in claim.scenarios),
        }
        changed = claim.model_copy(update=changes)
        out += [(name, changed)] if changed != claim else []
    return out


def _explain(e: ValidationError, content: dict[str, Any]) -> str:
    """Return the place and the reason of the first thing that does not fit, with the nearest key of an unknown one."""
    found = e.errors()
    first = next((one for one in found if one["type"] == "extra_forbidden"), found[0])
    place, key = list(first["loc"]), str(first["loc"][-1])
    if place[0] == "claims" and len(place) > 1 and isinstance(place[1], int):
        given = content["claims"][place[1]]
        place[:2] = [f"claim {given.get('id', '?')!r}" if isinstance(given, dict) else f"claim {place[1]}"]
    if first["type"] == "extra_forbidden":
        models: dict[Any, type[BaseModel]] = {"claims": Claim, "variants": Variant, "dimensions": Dimension}
        known = list((Choice if "choices" in place else models.get(first["loc"][0], Ledger)).model_fields)
        return f", {', '.join(map(str, place[:-1])) or 'ledger'}: there is no key {key!r}; {nearest(key, known)}"
    return f": {'.'.join(map(str, place))}: {plain_words(first)}"


def _error_of_claim(claim: Claim, alike: int) -> str:
    """Return the first thing that is wrong with the keys of a claim; empty where all is well."""
    if claim.kind not in KINDS:
        return f"there is no kind {claim.kind!r}; {nearest(claim.kind, list(KINDS))}"
    kind, given = KINDS[claim.kind], claim.model_fields_set
    ranges = [label for label in claim.scenarios if "{" in label]
    small = claim.kind in RELATIVE and claim.size is not None and abs(claim.size) <= claim.margin
    reasons = {
        **{f"kind {claim.kind!r} needs {key!r}: add it": True for key in sorted(kind.needs - given)},
        **{
            f"kind {claim.kind!r} does not use {key!r}; it takes {', '.join(sorted(kind.needs | kind.may))}": True
            for key in sorted(given - kind.needs - kind.may - ALWAYS)
        },
        "there are two claims of that id: give each its own": alike > 1,
        f"kind {claim.kind!r} needs at least 2 scenarios: add some": kind.scenarios == "later"
        and len(claim.scenarios) < 2,
        f"kind {claim.kind!r} takes no range like {(ranges or [''])[0]!r}: list the scenarios": bool(ranges)
        and kind.scenarios != "all",
        f"size {claim.size} is not beyond margin {claim.margin}: make margin smaller": small,
    }
    return next((reason for reason, holds in reasons.items() if holds), "")
