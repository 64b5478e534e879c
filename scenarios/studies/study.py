"""A study: scenarios x configured estimators x trials, written in a TOML file.

    title = "How it is called"                         # of its report's page; none: what it asks
    about = "what it asks"
    trials = 100
    baseline = "arl"                                   # what every estimator is compared with
    scenarios = ["packet-drop/drop={0,0.5,0.9}"]       # `sweep.py` says what braces and variants are
    estimators = ["arl", "mrsl-rssi[particles={50,200}]", "mrsl-rssi[consistent]"]
    variants = { consistent = "density=exact,M=1,K=1" }

    [[also]]                                           # more scenarios with estimators of their own
    scenarios = ["scalability/n=50"]
    estimators = ["arl"]

A study that includes others by name runs everything that they have.

    [training]                                         # what `cooploc tune` uses instead of a recording that is judged
    "mrclam/none[start=300]" = ["mrclam/none[duration=300]"]
"""

import re
import tomllib
from collections.abc import Iterator
from importlib.resources import files
from pathlib import Path
from typing import Annotated, Any, NamedTuple

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from cooploc.estimators.plugins.errors import BadInput, first_reason, nearest
from cooploc.scenarios.studies.sweep import MOST_LABELS, expand, named

Labels = tuple[str, ...]
Trials = Annotated[int, Field(strict=True, ge=1, le=1_000_000)]
Seed = Annotated[int, Field(strict=True, ge=0, lt=2**63)]
Seconds = Annotated[float, Field(strict=True, gt=0)]
MOST_PAIRS = 100_000  # (scenario, estimator) of a block


class Block(BaseModel):
    """Scenarios, and the estimators that run on each of them."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    scenarios: Annotated[Labels, Field(min_length=1)]
    estimators: Annotated[Labels, Field(min_length=1)]
    baseline: str = ""  # as the study's
    experiment: str = ""  # the study's name
    variants: dict[str, str] = {}


class StudyCell(NamedTuple):
    """What a study does with one scenario, as labels."""

    experiment: str
    scenario: str
    estimators: Labels
    baseline: str


class Study(BaseModel):
    """What a study file says."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    name: Annotated[str, Field(min_length=1, max_length=200)]
    title: Annotated[str, Field(max_length=130)] = ""  # of its report's page; none: what it is about
    about: str = ""
    minutes: Annotated[float, Field(gt=0)] | None = None  # about how long it takes as shipped, on two cores
    trials: Trials = 100
    seed: Seed = 1
    time_limit: Seconds = 600.0  # [s] for one estimator on one trial
    baseline: str = ""  # the estimator that every other one is compared with, by name or configured
    variants: dict[str, str] = {}  # named overrides of scenarios or estimators
    scenarios: Labels = ()
    estimators: Labels = ()
    also: tuple[Block, ...] = ()
    include: tuple[str, ...] = ()  # other studies, by name or path
    training: dict[str, Labels] = {}  # scenario -> those that estimators are tuned on instead; none: it is only judged
    tuned_with: Seed | None = None  # the seed of the streams that its estimators were tuned on; no run may have it
    leaves_out_misfits: bool = (
        False  # an estimator whose channels a scenario lacks is not run there; else all is refused
    )
    only: Labels = ()  # the estimators to run; one that the study lacks runs on every scenario

    def with_options(self, **options: Any) -> "Study":
        """The study with these fields replaced; None leaves a field as it is.

        Raises:
            BadInput: a value out of bounds.

        """
        given = {key: value for key, value in options.items() if value is not None}
        return _validated({**self.model_dump(), **given}, f"study {self.name!r}")

    @property
    def folder_name(self) -> str:
        """The name as that of a directory, which stays inside the one that it is in."""
        return re.sub(r"[/\\\x00-\x1f\x7f-\x9f]+", "-", self.name).lstrip(".") or "study"

    def blocks(self) -> list[Block]:
        """Its own scenarios with their estimators, then the others."""
        own = [Block(scenarios=self.scenarios, estimators=self.estimators)] if self.scenarios else []
        return [self._filled(block) for block in (*own, *self.also)]

    def expanded(self) -> Iterator[StudyCell]:
        """Every block's scenarios, in order; one that several blocks have, several times."""
        for block in self.blocks():
            estimators = tuple(self._labels(block.estimators, block.variants))
            scenarios = self._labels(block.scenarios, block.variants)
            if (pairs := len(scenarios) * len(estimators)) > MOST_PAIRS:
                raise BadInput(
                    f"study {self.name!r} has {pairs} pairs of scenario and estimator, and at most {MOST_PAIRS} are "
                    "allowed: divide it"
                )
            for scenario in scenarios:
                yield StudyCell(block.experiment, scenario, estimators, block.baseline)

    def _labels(self, labels: Labels, variants: dict[str, str]) -> list[str]:
        """What labels stand for, in order."""
        found: list[str] = []
        for label in labels:
            found += expand(label, variants)
            if len(found) > MOST_LABELS:
                raise BadInput(f"study {self.name!r}: its labels stand for more than {MOST_LABELS}: divide the study")
        return found

    def cells(self) -> list[StudyCell]:
        """Everything that is to run, by scenario, each scenario and each estimator once.

        Raises:
            BadInput: a label that cannot be read, or a scenario whose baseline is not among its estimators.

        """
        found: dict[str, StudyCell] = {}
        for new in self.expanded():
            cell = found.get(new.scenario, new)
            estimators = tuple(dict.fromkeys((*cell.estimators, *new.estimators)))
            found[new.scenario] = cell._replace(estimators=estimators)
        for cell in found.values():
            if cell.baseline not in cell.estimators:
                raise BadInput(
                    f"study {self.name!r} compares with {cell.baseline!r}, which is not one of its estimators on "
                    f"{cell.scenario!r}: add it there"
                )
        return self._chosen(list(found.values()))

    def baselines(self) -> dict[str, str]:
        """What each scenario's estimators are compared with."""
        return {cell.scenario: cell.baseline for cell in self.cells()}

    def _filled(self, block: Block) -> Block:
        variants = {**self.variants, **block.variants}
        return Block(
            scenarios=block.scenarios,
            estimators=block.estimators,
            baseline=named(block.baseline or self.baseline, variants) or expand(block.estimators[0], variants)[0],
            experiment=block.experiment or self.name,
            variants=variants,
        )

    def _chosen(self, cells: list[StudyCell]) -> list[StudyCell]:
        """The cells with the estimators of `only`."""
        if not self.only:
            return cells
        known = {name for cell in cells for name in cell.estimators}
        wanted = [name for label in self.only for name in expand(label, self.variants)]
        chosen = []
        for cell in cells:
            mine = tuple(name for name in dict.fromkeys(wanted) if name in cell.estimators or name not in known)
            if mine:
                baseline = cell.baseline if cell.baseline in mine else mine[0]
                chosen.append(cell._replace(estimators=mine, baseline=baseline))
        return chosen


def names() -> list[str]:
    """The studies that are shipped."""
    return sorted(
        path.name.removesuffix(".toml")
        for path in files(__package__).iterdir()
        if path.name.endswith(".toml") and not path.name.endswith(".log.toml")  # those describe recordings
    )


def load(which: str) -> Study:
    """A shipped study by name, or any study by the path of its TOML file; what it includes is written out.

    Raises:
        BadInput: there is none, or the file is not a study; says the line or the key.

    """
    return _load(which, ())


def _load(which: str, including: tuple[str, ...]) -> Study:
    if which in including:
        raise BadInput(f"study {which!r} includes itself, by way of {' and '.join(including)}: leave one out")
    path = _path(which)
    try:
        content = tomllib.loads(path.read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as e:
        raise BadInput(f"{which} is not a TOML file: {e}") from None
    except RecursionError:
        raise BadInput(f"{which} is not a study: its arrays are nested too deeply") from None
    study = _validated({"name": path.name.removesuffix(".toml"), **content}, which)
    others = [_load(other, (*including, which)) for other in study.include]
    also = (*study.also, *(block for other in others for block in other.blocks()))
    training = {key: value for other in (*others, study) for key, value in other.training.items()}
    study = study.model_copy(update={"also": also, "training": training, "include": ()})
    if not study.blocks():
        raise BadInput(f"{which} has no scenarios: give scenarios and estimators, or include other studies")
    try:
        study.cells()
    except BadInput as e:
        raise BadInput(f"{which}: {e}") from None
    return study


def _path(which: str) -> Any:
    if which.endswith(".toml"):
        if not Path(which).is_file():
            raise BadInput(f"there is no study file {which}; name a TOML file or one of {', '.join(names())}")
        return Path(which)
    if which not in names():
        raise BadInput(f"there is no study {which!r}; {nearest(which, names())}")
    return files(__package__) / f"{which}.toml"


def _validated(content: dict[str, Any], where: str) -> Study:
    _demand_known(content, Study, "a study", where)
    also = content.get("also")
    for block in also if isinstance(also, list) else ():  # anything else is refused below
        _demand_known(block, Block, "a block of [[also]]", where)
    if content.get("scenarios") and not content.get("estimators"):
        raise BadInput(f"{where}: it has scenarios and no estimators: name some")
    try:
        study = Study(**content)
    except ValidationError as e:
        raise BadInput(f"{where}: {first_reason(e.errors())}") from None
    if study.seed == study.tuned_with:
        raise BadInput(f"{where}: its estimators were tuned on the streams of seed {study.seed}; choose another seed")
    return study


def _demand_known(content: Any, model: type[BaseModel], what: str, where: str) -> None:
    for key in content if isinstance(content, dict) else ():
        if key not in model.model_fields:
            raise BadInput(f"{where}: there is no key {key!r} in {what}; {nearest(key, list(model.model_fields))}")
