"""A study: scenarios x configured estimators x trials, written in a TOML file.

    title = "How it is called"                         # of its report's page; none: what it asks
    about = "what it asks"
    trials = 100
    baseline = "arl"                                   # what every estimator is compared with
    scenarios = ["packet-drop/drop={0,0.5,0.9}"]
    estimators = ["arl", "mrsl-rssi[particles={50,200}]", "mrsl-rssi[consistent]"]
    variants = { consistent = "density=exact,M=1,K=1" }

    [[also]]                                           # more scenarios with estimators of their own
    scenarios = ["scalability/n=50"]
    estimators = ["arl"]

    [training]                                         # what `cooploc tune` uses instead of a recording that is judged
    "mrclam/none[start=300]" = ["mrclam/none[duration=300]"]

Braces sweep a parameter, as in a shell: a list, or first..last or first..last..step, both ends included. A word in
brackets that is not name=value is a variant: overrides to which the study gives a name. A study that includes others by
name runs everything that they have.
"""

import hashlib
import re
import tomllib
from collections import Counter
from collections.abc import Iterator, Mapping
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from cooploc import scenarios as registry
from cooploc.estimators import configure
from cooploc.estimators.building import ConfiguredEstimator
from cooploc.estimators.errors import BadInput, first_reason, nearest
from cooploc.estimators.label_syntax import MOST_LABELS, expand, shorten_labels, write_out_variants
from cooploc.estimators.plugin_files import is_file
from cooploc.estimators.registry import source_of
from cooploc.scenarios import resolve
from cooploc.scenarios.scenario import ResolvedScenario, split_family

if TYPE_CHECKING:
    from pandas import DataFrame


Labels = tuple[str, ...]
Trials = Annotated[int, Field(strict=True, ge=1, le=1_000_000)]
Seed = Annotated[int, Field(strict=True, ge=0, lt=2**63)]
Seconds = Annotated[float, Field(strict=True, gt=0)]


class Block(BaseModel):
    """Scenarios, and the estimators that run on each of them."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    scenarios: Annotated[Labels, Field(min_length=1)]
    estimators: Annotated[Labels, Field(min_length=1)]
    baseline: str = ""  # as the study's
    experiment: str = ""  # the study's name
    variants: dict[str, str] = {}


class StudyCell(NamedTuple):
    """A scenario of a study with its estimators, as labels."""

    experiment: str
    scenario: str
    estimators: Labels
    baseline: str


class Study(BaseModel):
    """The content of a study file."""

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
    streams: dict[
        str, str | Labels
    ] = {}  # scenario -> beginning of its stream's hash, or one for each kind of processor
    leaves_out_misfits: bool = False  # an estimator is not run where its channels lack; else the study is refused
    only: Labels = ()  # the estimators to run; one that the study lacks runs on every scenario

    def replace_options(self, **options: Any) -> "Study":
        """Return the study with these fields replaced; None leaves a field as it is."""
        given = {key: value for key, value in options.items() if value is not None}
        for key in ("trials", "seed"):
            if self.streams and given.get(key, fixed := getattr(self, key)) != fixed:
                raise BadInput(f"{self.name} fixes {key} at {fixed}, not {given[key]}: leave --{key} out")
        return _validate({**self.model_dump(), **given}, f"study {self.name!r}")

    def folder_name(self, data: str | Path | None = None) -> str:
        """Return the directory of a run, `STUDY-seedN`, with recordings `STUDY-DATA-seedN`; it stays inside another."""
        of_data = (
            [Path(data).resolve().name.replace(" ", "-")] if data else []
        )  # the name is to be copied into a command
        named = "-".join([self.name.lstrip(".") or "study", *of_data, f"seed{self.seed}"])
        return re.sub(r"[/\\\x00-\x1f\x7f-\x9f]+", "-", named)

    def blocks(self) -> list[Block]:
        """Return its own scenarios with their estimators, then the others; defaults are filled in."""
        own = [Block(scenarios=self.scenarios, estimators=self.estimators)] if self.scenarios else []
        found = []
        for block in (*own, *self.also):
            variants = {**self.variants, **block.variants}
            baseline = write_out_variants(block.baseline or self.baseline, variants)
            baseline = baseline or expand(block.estimators[0], variants)[0]
            filled = {"baseline": baseline, "experiment": block.experiment or self.name, "variants": variants}
            found.append(block.model_copy(update=filled))
        return found

    def expand_blocks(self) -> Iterator[StudyCell]:
        """Yield every block's scenarios, in order; one that several blocks have, several times."""
        for block in self.blocks():
            estimators, scenarios = (
                tuple(one for label in labels for one in expand(label, block.variants))
                for labels in (block.estimators, block.scenarios)
            )
            if len(estimators) * len(scenarios) > 10 * MOST_LABELS:
                count = f"{len(scenarios)} scenarios and {len(estimators)} estimators"
                raise BadInput(f"study {self.name!r}: {count} make more pairs than {10 * MOST_LABELS}: divide it")
            for scenario in scenarios:
                yield StudyCell(block.experiment, scenario, estimators, block.baseline)

    def cells(self) -> list[StudyCell]:
        """Return everything that is to run, by scenario, each scenario and each estimator once."""
        found: dict[str, StudyCell] = {}
        for new in self.expand_blocks():
            cell = found.get(new.scenario, new)
            estimators = tuple(dict.fromkeys((*cell.estimators, *new.estimators)))
            found[new.scenario] = cell._replace(estimators=estimators)
        for cell in found.values():
            if cell.baseline not in cell.estimators:
                raise BadInput(
                    f"study {self.name!r} compares with {cell.baseline!r}, which is not one of its estimators on "
                    f"{cell.scenario!r}: add it there"
                )
        if not self.only:
            return list(found.values())
        known = {name for cell in found.values() for name in cell.estimators}
        wanted = [name for label in self.only for name in expand(label, self.variants)]
        if self.leaves_out_misfits:  # a name alone is the one configuration of it that fits the study's recordings
            written = [[label for label in known if label.partition("[")[0] == name] for name in wanted]
            wanted = [own[0] if len(own) == 1 else name for name, own in zip(wanted, written, strict=True)]
        chosen = []
        for cell in found.values():
            mine = tuple(name for name in dict.fromkeys(wanted) if name in cell.estimators or name not in known)
            if mine:
                baseline = cell.baseline if cell.baseline in mine else mine[0]
                chosen.append(cell._replace(estimators=mine, baseline=baseline))
        return chosen

    def baselines(self) -> dict[str, str]:
        """Return the baseline of each scenario."""
        return {cell.scenario: cell.baseline for cell in self.cells()}


PROBLEMS = "problems.toml"


def names() -> list[str]:
    """Return the studies that are shipped."""
    shipped = {path.name for path in files(__package__).iterdir() if path.name.endswith(".toml")}
    return sorted(name.removesuffix(".toml") for name in shipped - {PROBLEMS})


def problem_tables() -> dict[str, dict[str, Any]]:
    """Return the content of every problem as a study's, by its name and version, such as arena-3@1."""
    shared = tomllib.loads((files(__package__) / PROBLEMS).read_text(encoding="utf-8"))
    own = {name: shared.pop(name) for name, value in list(shared.items()) if isinstance(value, dict)}
    return {name: {"name": name, "scenarios": [*one["streams"]], **shared, **one} for name, one in own.items()}


def load(which: str, including: tuple[str, ...] = ()) -> Study:
    """Read a shipped study or a problem by name, or any study by its TOML file; what it includes is written out.

    Raises:
        BadInput: there is none, or the file is not a study; says the line or the key.
    """
    if which in including:
        raise BadInput(f"study {which!r} includes itself, by way of {' and '.join(including)}: leave one out")
    path: Any = Path(which)
    if not which.endswith(".toml"):
        if which in (problems := problem_tables()):
            return _validate(problems[which], which)
        if which not in names():
            raise BadInput(f"there is no study {which!r}; {nearest(which, [*names(), *problems])}")
        path = files(__package__) / f"{which}.toml"
    elif not path.is_file():
        raise BadInput(f"there is no file {which}; check its path, or name a shipped study (cooploc list studies)")
    try:
        content = tomllib.loads(path.read_text(encoding="utf-8-sig"))
    except (ValueError, RecursionError) as e:  # not TOML, not UTF-8, or arrays nested too deeply
        raise BadInput(f"{which} is not a TOML file: {e}") from None
    study = _validate({"name": path.name.removesuffix(".toml"), **content}, which)
    others = [load(other, (*including, which)) for other in study.include]
    also = (*study.also, *(block for other in others for block in other.blocks()))
    training = {key: value for other in (*others, study) for key, value in other.training.items()}
    study = study.model_copy(update={"also": also, "training": training, "include": ()})
    try:
        if not (cells := study.cells()):
            raise BadInput("it has no scenarios: give scenarios and estimators, or include other studies")
        for label in {label for cell in cells for label in (cell.scenario, *cell.estimators)}:
            file = label.partition(":")[0]
            if file.endswith(".py") and not Path(file).exists() and (beside := Path(which).with_name(file)).exists():
                raise BadInput(
                    f"there is no file {file} in this directory: write {beside}, or run it in {beside.parent}"
                )
    except BadInput as e:
        raise BadInput(f"{which}: {e}") from None
    return study


def is_scenario(label: str) -> bool:
    """Return whether a label is that of a scenario, or of a sweep of some, and no study is called so."""
    family = split_family(label.partition("[")[0])[0]
    is_study = label.endswith(".toml") or label in names() or label in problem_tables()
    return not is_study and (registry.REGISTRY.has(family) or is_file(family))


def study_of_scenario(label: str, estimators: Labels) -> Study:
    """Return a study of a scenario, or of a sweep of some: twenty trials, compared with the first estimator."""
    name = re.sub(r"[^\w.=-]+", "-", label.replace("={", "=")).strip("-")[:100]
    content = {"name": name, "title": label[:130], "trials": 20, "scenarios": (label,), "estimators": estimators}
    return _validate(content, label)


def _validate(content: dict[str, Any], where: str) -> Study:
    if content.get("scenarios") and not content.get("estimators"):
        raise BadInput(f"{where}: it has scenarios and no estimators: name some")
    try:
        study = Study(**content)
    except ValidationError as e:
        *outer, key = map(str, e.errors()[0]["loc"] or ("",))
        if e.errors()[0]["type"] != "extra_forbidden":
            raise BadInput(f"{where}: {first_reason(e.errors())}") from None
        what, model = ("a block of [[also]]", Block) if outer else ("a study", Study)
        remedy = nearest(key, list(model.model_fields))
        raise BadInput(f"{where}: there is no key {key!r} in {what}; {remedy}") from None
    if study.seed == study.tuned_with:
        raise BadInput(f"{where}: its estimators were tuned on the streams of seed {study.seed}; choose another seed")
    return study


def stream_sentence(study: Study, streams: Mapping[str, Mapping[str, str]]) -> str:
    """Return whether a run's streams, hashes by scenario and trial, are those that its study fixes; "" without any.

    A study that fixes streams fixes trials and seed, too: it is a problem.
    """
    found = {name: [one[t] for t in sorted(one, key=int)] for name, one in streams.items()}
    hashes = {name: hashlib.sha256("".join(one).encode()).hexdigest() for name, one in found.items()}
    other = [name for name, stated in study.streams.items() if not hashes.get(name, "").startswith(stated)]
    if not study.streams or not other:
        return f"problem: {study.name}, and its streams are those that this name stands for" * bool(study.streams)
    why = "an unfinished run, other recordings, or a processor or libraries that round otherwise"
    return f"not the problem {study.name}: other streams in {' and '.join(other)} ({why}); do not cite this name"


# A study with every label read, before anything runs.


class ResolvedCell(NamedTuple):
    """A scenario of a study with its estimators and trials."""

    experiment: str
    scenario: ResolvedScenario
    trials: Mapping[str, int]  # by the label of an estimator
    estimators: tuple[ConfiguredEstimator, ...]
    baseline: str  # the label of one of them

    @property
    def most(self) -> int:
        """Trials of the estimator that has most."""
        return max(self.trials.values())


class ResolvedStudy(NamedTuple):
    """Everything that is to run."""

    study: Study
    data: Path | None  # the directory of recordings
    cells: tuple[ResolvedCell, ...]

    @property
    def estimators(self) -> list[ConfiguredEstimator]:
        """Every estimator once, in the order in which scenarios name them."""
        return list({one.label: one for cell in self.cells for one in cell.estimators}.values())

    def limit_trials(self, counts: Mapping[tuple[str, str], int]) -> "ResolvedStudy":
        """Return the same with these numbers of trials, by the labels of scenario and estimator; none above its own."""
        cells = []
        for cell in self.cells:
            asked = {name: min(counts[cell.scenario.label, name], n) for name, n in cell.trials.items()}
            cells.append(cell._replace(trials=asked))
        return self._replace(cells=tuple(cells))


def resolve_study(study: Study, data: Path | None = None) -> ResolvedStudy:
    """Read every label of a study."""
    cells = study.cells()
    known = {label: configure(label) for label in dict.fromkeys(name for cell in cells for name in cell.estimators)}
    if same := [one for one, n in Counter(map(shorten_labels, known)).items() if n > 1]:
        raise BadInput(f"two estimators are called {same[0]!r}: give one of them another name")
    found = []
    for cell in cells:
        scenario = resolve(cell.scenario, data)
        trials = dict.fromkeys(cell.estimators, scenario.trials(study.trials))
        estimators = tuple(known[label] for label in cell.estimators)
        found.append(ResolvedCell(cell.experiment, scenario, trials, estimators, cell.baseline))
    return ResolvedStudy(study, data, tuple(found))


def list_studies() -> "DataFrame":
    """Return the table of shipped studies.

    Columns: `name`; `about`, its title and what it asks; `minutes`, how long it takes on two cores, nan where that
    depends on your data; `source`, the papers or data sets that its scenarios come from.
    """
    from pandas import DataFrame

    rows = []
    for one in map(load, names()):
        families = dict.fromkeys(re.split(r"[/\[]", cell.scenario)[0] for cell in one.cells())
        sources = dict.fromkeys(source_of(registry.family(name).model_class(name)) for name in families)
        about = ": ".join(filter(None, (one.title, one.about)))
        rows.append((one.name, about, one.minutes, "; ".join(filter(None, sources))))
    return DataFrame(rows, columns=["name", "about", "minutes", "source"]).astype({"minutes": float})


def list_problems() -> "DataFrame":
    """Return the table of problems, studies whose streams never change; `cl.run_study("arena-3@1")` runs one.

    Columns: `name` with its version; `about`, the world and what is sensed; `trials` and `seed`, which are fixed;
    `streams`, the scenarios with the beginnings of their streams' hashes, one for each kind of processor that rounds
    otherwise.
    """
    from pandas import DataFrame

    return DataFrame(list(problem_tables().values()))[["name", "about", "trials", "seed", "streams"]]
