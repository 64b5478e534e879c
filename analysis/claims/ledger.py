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
from collections.abc import Mapping
from importlib.resources import files
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field, ValidationError

from cooploc.analysis.claims.interpretations import Dimension, find_error
from cooploc.analysis.claims.kinds import Claim, LedgerTable
from cooploc.estimators.errors import BadInput, plain_words

BASE = "paper"  # the variant without substitutions


class Variant(LedgerTable):
    """Another reading of the paper, as substitutions."""

    about: str = ""
    estimators: Mapping[str, str] = {}
    scenarios: Mapping[str, str] = {}


class Ledger(LedgerTable):
    """A ledger's file."""

    paper: str
    claims: Annotated[tuple[Claim, ...], Field(min_length=1)]
    variants: Mapping[str, Variant] = {}
    dimensions: Mapping[str, Dimension] = {}  # in which the paper can be read in several ways

    def __repr__(self) -> str:
        return f"Ledger({self.paper!r}, {len(self.claims)} claims, {len(self.variants)} variants)"


def load(path: Ledger | str | Path | None = None) -> Ledger:
    """Read the ledger of a TOML file; without a path, that of Latif & Parasuraman (2022). A ledger stays as it is."""
    if isinstance(path, Ledger):
        return path
    file: Any = files(__package__) / "claims.toml" if path is None else Path(path)
    try:
        content = tomllib.loads(file.read_text(encoding="utf-8-sig"))
    except OSError as e:
        raise BadInput(f"the ledger {path} cannot be read: {e.strerror}; name a TOML file") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as e:
        raise BadInput(f"{path} is not a TOML file: {e}") from None
    return read(content, str(path or "claims.toml"))


def read(content: dict[str, Any], where: str) -> Ledger:
    """Return the ledger that the content of a file describes."""
    try:
        ledger = Ledger(**content)
    except ValidationError as e:
        first = e.errors()[0]
        place = list(first["loc"])
        if place[0:1] == ["claims"] and place[1:]:
            given = content["claims"][place[1]]
            place[:2] = [f"claim {given.get('id', '?') if isinstance(given, dict) else given!r}"]
        raise BadInput(f"{where}: {'.'.join(map(str, place))}{': ' * bool(place)}{plain_words(first)}") from None
    names = [claim.id for claim in ledger.claims]
    for name in [name for name in names if names.count(name) > 1]:
        raise BadInput(f"{where}: claim {name!r}: there are two claims of that id: give each its own")
    if BASE in ledger.variants:
        raise BadInput(f"{where}: a variant cannot be called {BASE!r}, as the claims as they stand are: rename it")
    if wrong := find_error(ledger.dimensions, ledger.claims):
        raise BadInput(f"{where}: {wrong}")
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
