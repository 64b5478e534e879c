"""`cooploc new-estimator NAME`: a small package with an estimator that runs, its test, and what registers it."""

import re
from importlib.resources import files
from pathlib import Path

from jinja2 import Template

from cooploc.estimators import BUILTIN
from cooploc.estimators.errors import BadInput


def new_estimator(name: str, folder: str | Path | None = None) -> list[Path]:
    """Write a small package with an estimator that runs, its test, and what registers it; returns its files.

    Args:
        name: of the estimator: small letters, digits and hyphens, such as my-filter.
        folder: where to write; a new directory of that name where not given.

    Raises:
        BadInput: the name cannot be used, or the folder exists.

    """
    if not re.fullmatch(r"[a-z][a-z0-9]*(-[a-z0-9]+)*", name):
        raise BadInput(f"{name!r} cannot name an estimator: write small letters, digits and hyphens, such as my-filter")
    if name in BUILTIN:
        raise BadInput(f"{name!r} is a built-in estimator: choose another name")
    home = Path(name if folder is None else folder)
    if home.exists():
        raise BadInput(f"{home} exists: choose another name, or remove it")
    module = f"{name.replace('-', '_')}_estimator"
    words = {"name": name, "module": module, "cls": "".join(part.capitalize() for part in name.split("-"))}
    templates = {
        "pyproject.toml": "pyproject.toml.j2",
        f"{module}.py": "estimator.py.j2",
        "README.md": "README.md.j2",
        f"test_{module}.py": "test_estimator.py.j2",
        ".github/workflows/compare.yml": "compare.yml.j2",
    }
    for file, template in templates.items():
        (home / file).parent.mkdir(parents=True, exist_ok=True)
        source = (files(__package__) / "templates" / template).read_text(encoding="utf-8")
        (home / file).write_text(Template(source, keep_trailing_newline=True).render(words), encoding="utf-8")
    return [home / file for file in templates]
