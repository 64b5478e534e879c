"""A study: scenarios x configured estimators x trials, written as a TOML file."""

import tomllib
from importlib.resources import files
from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from cooploc.estimators import nearest
from cooploc.estimators.bad_input import BadInput


class Study(BaseModel):
    """What a study file says."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    name: str
    about: str = ""
    trials: Annotated[int, Field(ge=1)] = 100
    seed: Annotated[int, Field(ge=0)] = 1
    baseline: str  # the estimator that every other one is compared with, by name or configured
    scenarios: Annotated[tuple[str, ...], Field(min_length=1)]
    estimators: Annotated[tuple[str, ...], Field(min_length=1)]

    def with_options(self, **options: Any) -> "Study":
        """The study with what the command line says instead; None leaves it as it is.

        Raises:
            BadInput: a value out of bounds.

        """
        given = {key: value for key, value in options.items() if value is not None}
        return _validated({**self.model_dump(), **given}, f"study {self.name!r}")


def names() -> list[str]:
    """The studies that are shipped."""
    return sorted(
        path.name.removesuffix(".toml")
        for path in files(__package__).iterdir()
        if path.name.endswith(".toml") and not path.name.endswith(".log.toml")  # those describe recordings
    )


def load(which: str) -> Study:
    """A shipped study by name, or any study by the path of its TOML file.

    Raises:
        BadInput: there is none, or the file is not a study; says the line or the key.

    """
    if which.endswith(".toml"):
        path: Any = Path(which)
        if not path.is_file():
            raise BadInput(f"there is no study file {which}; name a TOML file or one of {', '.join(names())}")
    elif which in names():
        path = files(__package__) / f"{which}.toml"
    else:
        raise BadInput(f"there is no study {which!r}; {nearest(which, names())}")
    try:
        content = tomllib.loads(path.read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as e:
        raise BadInput(f"{which} is not a TOML file: {e}") from None
    return _validated({"name": path.name.removesuffix(".toml"), **content}, which)


def _validated(content: dict[str, Any], where: str) -> Study:
    for key in content:
        if key not in Study.model_fields:
            raise BadInput(f"{where}: there is no key {key!r} in a study; {nearest(key, list(Study.model_fields))}")
    try:
        return Study(**content)
    except ValidationError as e:
        first = e.errors()[0]
        raise BadInput(f"{where}: {'.'.join(map(str, first['loc']))}: {first['msg']}") from None
