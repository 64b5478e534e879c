"""The manifest of a run directory: reading it, going on with it, and what it says that a part's bits depend on."""

import re
from pathlib import Path
from typing import Any

from cooploc.analysis.execution.piece import Piece, trials_of
from cooploc.analysis.execution.schemas import Manifest, Newer, checked
from cooploc.estimators.errors import BadInput
from cooploc.scenarios.sealed import Damaged, digest

NAME = "manifest.json"
LISTED = 8  # runs below a directory that is none, at most
MUST_MATCH = {  # of a run that goes on, and what is said where it differs
    "seed": "another seed",
    "data": "other recordings",
    "versions": "other versions of the libraries",
    "source": "another version of cooploc",
    "instructions": "another kind of processor",
}
BEGUN = re.compile(r"\.lock|parts|receipts|\.manifest\.json\..*")  # all that is there before the first manifest
REMEDY = "the command that began the run makes it again where all parts agree; else name another directory with --out"


class DamagedManifest(BadInput):
    """The manifest is not what was written, or is gone though there are parts."""


def read_manifest(folder: Path) -> dict[str, Any]:
    """What a directory says it holds; empty where nothing was run into it yet.

    Raises:
        BadInput: the directory holds something else, or a newer format.
        DamagedManifest: it is not what was written.

    """
    file = folder / NAME
    if not file.is_file():
        refuse_foreign(folder)
        if any(trials_of(file.name) for file in folder.glob("parts/*")):
            raise DamagedManifest(f"{file} is gone, and there are parts: {REMEDY}")
        return {}
    try:
        found = checked(file.read_bytes(), Manifest)
    except Newer as e:
        raise BadInput(f"{file} has {e}") from None
    except Damaged as e:
        raise DamagedManifest(f"{file} is damaged: {e}; {REMEDY}") from None
    return {"files": {}, "certificates": {}, **found}


def refuse_foreign(folder: Path) -> None:
    """Refuse what neither holds a run nor was about to.

    Raises:
        BadInput: it is something else.

    """
    if (folder / NAME).is_file():
        return
    if folder.is_dir():
        names = [file.name for file in folder.iterdir()]
        ours = all(map(BEGUN.fullmatch, names)) or {"parts", "receipts"} <= set(names)
    else:
        ours = not (folder.exists() or folder.is_symlink())
    if not ours:
        runs = sorted(str(path.parent) for path in folder.glob(f"*/{NAME}")) if folder.is_dir() else []
        there = f"; there are {', '.join(runs[:LISTED])}{', ...' * (len(runs) > LISTED)}" if runs else ""
        raise BadInput(f"{folder} exists and is not a run directory{there or '; name another with --out'}")


def continued(folder: Path, found: dict[str, Any], asked: dict[str, Any]) -> dict[str, Any]:
    """The manifest of a run that goes on with what is asked now.

    Raises:
        BadInput: it has other settings.

    """
    for key, said in MUST_MATCH.items():
        if found.get(key) != asked[key]:
            raise BadInput(f"{folder} holds a run with {said}; name another directory with --out")
    for path, hashed in asked["files"].items():
        if found["files"].get(path, hashed) != hashed:
            raise BadInput(f"{folder} holds results of another version of {path}; name another with --out")
    for path, versions in asked["imports"].items():
        before = found.get("imports", {}).get(path, versions)
        if before != versions:
            changed = ", ".join(sorted({name for name, _ in before.items() ^ versions.items()}))
            raise BadInput(
                f"{folder} holds results of {path} with other versions of {changed}; name another with --out"
            )
    for label, parameters in asked["scenarios"].items():
        if found["scenarios"].get(label, parameters) != parameters:
            raise BadInput(f"{folder} holds another scenario {label!r}; name another directory with --out")
    return {
        **asked,
        "scenarios": {**found["scenarios"], **asked["scenarios"]},
        "files": {**found["files"], **asked["files"]},
        "imports": {**found.get("imports", {}), **asked["imports"]},
        "cells": _both(found["cells"], asked["cells"]),
        "certificates": found["certificates"],
        "streams": found["streams"],
        "isolated": asked["isolated"] and found.get("isolated", True),
    }


def _both(found: dict[str, Any], asked: dict[str, Any]) -> dict[str, Any]:
    """What was asked of each scenario before, with what is asked now."""
    joined = dict(found)
    for scenario, cell in asked.items():
        before = found.get(scenario, {}).get("estimators", {})
        trials = {name: max(count, before.get(name, 0)) for name, count in cell["estimators"].items()}
        joined[scenario] = {**cell, "estimators": {**before, **trials}}
    return joined


def settings(manifest: dict[str, Any], piece: Piece) -> str:
    """A digest of what a part's bits depend on: seed, versions and source, its scenario, the files of its plug-ins."""
    files, imports = (_of(piece, manifest.get(kind, {})) for kind in ("files", "imports"))
    of_all = {key: manifest.get(key) for key in MUST_MATCH}
    plugged = {"files": files, "imports": imports} if imports else {"files": files}  # as earlier versions did
    return digest({**of_all, "scenario": manifest.get("scenarios", {}).get(piece.scenario), **plugged})


def _of(piece: Piece, plugged: dict[str, Any]) -> dict[str, Any]:
    """Those of the plug-ins of a piece's scenario and estimator."""
    return {path: one for path, one in plugged.items() if any(label.startswith(path) for label in piece[:2])}
