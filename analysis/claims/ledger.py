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

from cooploc.analysis.claims import interpretations
from cooploc.analysis.claims.interpretations import Choice, Dimension
from cooploc.analysis.claims.kinds import KINDS, RELATIVE, STRICT, Claim
from cooploc.estimators import nearest
from cooploc.estimators.plugins.errors import BadInput
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
    """What a ledger's file says."""

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
    """The ledger of a TOML file; without a path, that of Latif & Parasuraman (2022).

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
    """A ledger from what its file holds.

    Raises:
        BadInput: an unknown key, a value that does not fit, or a key that the claim's kind needs or does not use.

    """
    _demand_known(content, Ledger, where, "a ledger")
    for claim in _listed(content.get("claims", []), where):
        _demand_known(claim, Claim, f"{where}, claim {claim.get('id', '?')!r}", "a claim")
        _demand_kind(claim, where)
    for name, variant in _tables(content, "variants").items():
        _demand_known(variant, Variant, f"{where}, variant {name!r}", "a variant")
    for name, dimension in _tables(content, "dimensions").items():
        _demand_known(dimension, Dimension, f"{where}, dimension {name!r}", "a dimension")
        for choice, parameters in _tables(dimension, "choices").items():
            _demand_known(parameters, Choice, f"{where}, dimension {name!r}, choice {choice!r}", "a choice")
    try:
        ledger = Ledger(**content)
    except ValidationError as e:
        first = e.errors()[0]
        raise BadInput(f"{where}: {'.'.join(map(str, first['loc']))}: {first['msg']}") from None
    _demand_sense(ledger, where)
    return ledger


def variants(claim: Claim, ledger: Ledger) -> list[tuple[str, Claim]]:
    """The claim as it stands, and again for every variant that changes it.

    A variant replaces all of a claim's scenarios or none, for a comparison between two kinds of worlds would say
    nothing about either; of its estimators it replaces those it names.
    """
    out = [(BASE, claim)]
    for name, variant in ledger.variants.items():
        known = all(label in variant.scenarios for label in claim.scenarios)
        if variant.scenarios and not known:
            continue
        changes = {
            "of": tuple(variant.estimators.get(label, label) for label in claim.of),
            "than": tuple(variant.estimators.get(label, label) for label in claim.than),
            "scenarios": tuple(variant.scenarios.get(label, label) for label in claim.scenarios),
        }
        changed = claim.model_copy(update=changes)
        out += [(name, changed)] if changed != claim else []
    return out


def _listed(claims: Any, where: str) -> list[dict[str, Any]]:
    if not (isinstance(claims, list) and all(isinstance(claim, dict) for claim in claims)):
        raise BadInput(f"{where}: claims must be a list of tables: write [[claims]]")
    return claims


def _tables(given: Any, key: str) -> dict[str, Any]:
    """The tables under a key; nothing where it is something else, which the model refuses."""
    found = given.get(key) if isinstance(given, dict) else None
    return found if isinstance(found, dict) else {}


def _demand_known(given: Any, model: type[BaseModel], where: str, what: str) -> None:
    for key in given if isinstance(given, dict) else ():
        if key not in model.model_fields:
            raise BadInput(f"{where}: there is no key {key!r} in {what}; {nearest(key, list(model.model_fields))}")


def _demand_kind(claim: dict[str, Any], where: str) -> None:
    """The keys of a claim are those of its kind."""
    who, kind = f"{where}, claim {claim.get('id', '?')!r}", claim.get("kind")
    if kind is None:
        raise BadInput(f"{who}: has no kind; known are {', '.join(KINDS)}")
    if kind not in KINDS:
        raise BadInput(f"{who}: there is no kind {kind!r}; {nearest(str(kind), list(KINDS))}")
    needs, may = KINDS[kind].needs, KINDS[kind].may
    for key in sorted(needs - set(claim)):
        raise BadInput(f"{who}: kind {kind!r} needs {key!r}: add it")
    for key in sorted(set(claim) - needs - may - ALWAYS):
        raise BadInput(f"{who}: kind {kind!r} does not use {key!r}; it takes {', '.join(sorted(needs | may))}")


def _demand_sense(ledger: Ledger, where: str) -> None:
    names = [claim.id for claim in ledger.claims]
    for claim in ledger.claims:
        who = f"{where}, claim {claim.id!r}"
        if names.count(claim.id) > 1:
            raise BadInput(f"{who}: there are two claims of that id: give each its own")
        kind = KINDS[claim.kind]
        if kind.scenarios == "later" and len(claim.scenarios) < 2:
            raise BadInput(f"{who}: kind {claim.kind!r} needs at least 2 scenarios: add some")
        ranges = [label for label in claim.scenarios if "{" in label]
        if ranges and kind.scenarios != "all":
            raise BadInput(f"{who}: kind {claim.kind!r} takes no range like {ranges[0]!r}: list the scenarios")
        if claim.kind in RELATIVE and claim.size is not None and abs(claim.size) <= claim.margin:
            raise BadInput(f"{who}: size {claim.size} is not beyond margin {claim.margin}: make margin smaller")
    if BASE in ledger.variants:
        raise BadInput(f"{where}: a variant cannot be called {BASE!r}, as the claims as they stand are: rename it")
    if wrong := interpretations.refusal(ledger.dimensions, ledger.claims):
        raise BadInput(f"{where}, {wrong}")
