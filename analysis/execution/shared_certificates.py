"""Certificates that runs share: a plug-in that was checked once is not checked again in another run's folder.

Each is a file of its own, named by a hash of all that it depends on: the estimator with its parameters and where its
file lies, its source with what it imports, this version of cooploc on this processor, and the study's worlds, trials
and seed. Whatever differs has another name. They lie in `certificates/` of COOPLOC_CACHE, by default of the user's
cache; nothing is shared where that is set to nothing. One that is damaged or not readable is ignored, in one line.
"""

import json
import os
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, Literal

from pydantic import BaseModel

from cooploc.analysis.execution import atomic_file
from cooploc.analysis.execution.provenance import bits
from cooploc.analysis.execution.schemas import FORMAT, Certificate, Digest, Newer, checked
from cooploc.scenarios.sealed import Damaged, digest, seal

VARIABLE = "COOPLOC_CACHE"


class Shared(BaseModel):
    """The file of one certificate."""

    format: Literal[2]
    key: Digest
    estimator: str
    certificate: Certificate


def folder() -> Path | None:
    """Where they lie; None where nothing is shared."""
    said = os.environ.get(VARIABLE)
    if said is None:
        said = os.path.join(os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache"), "cooploc")
    return Path(said).absolute() / "certificates" if said else None


def key(estimator: str, source: dict[str, str], worlds: Any) -> str:
    """The hash of what a certificate depends on.

    Args:
        estimator: its label, with the whole path of its file.
        source: hashes and versions of what it is made of.
        worlds: where it is checked, as JSON can hold it.

    """
    return digest({"estimator": estimator, "source": source, "worlds": worlds, "here": bits()})


def found(key: str, say: Callable[[str], None]) -> dict[str, Any] | None:
    """The certificate of this key, if another run has left it."""
    file = _file(key)
    try:
        if file is None or not file.is_file():
            return None
        held = checked(file.read_bytes(), Shared)
        if held["key"] != key:
            raise Damaged("it is of something else")
    except (Damaged, Newer, OSError) as e:
        say(f"the certificate {file} is ignored ({e}): delete it")
        return None
    certificate: dict[str, Any] = held["certificate"]
    return certificate


def keep(key: str, estimator: str, certificate: dict[str, Any], say: Callable[[str], None]) -> None:
    """Leave a certificate with a result for other runs."""
    file = _file(key)
    if file is None or not certificate["checks"]:
        return
    sealed = seal({"format": FORMAT, "key": key, "estimator": estimator, "certificate": certificate})
    text = json.dumps(sealed, indent=1)
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        atomic_file.replace(file, partial(Path.write_text, data=text, encoding="utf-8"))
    except OSError as e:
        say(f"the certificate of {estimator} is not kept for other runs ({e}): set {VARIABLE} to a folder of yours")


def _file(key: str) -> Path | None:
    there = folder()
    return None if there is None else there / f"{key}.json"
