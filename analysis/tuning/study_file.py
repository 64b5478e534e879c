"""A study with the tuned configurations, as an object and as the TOML file that `cooploc run` accepts."""

import json
from collections.abc import Mapping
from typing import Any

from cooploc.scenarios.studies.study import Block, Study, StudyCell

HEAD = """# Made by cooploc tune: every estimator as it was tuned on streams of another seed, which no run may have.
about = {about}
trials = {trials}
seed = {seed}
time_limit = {time_limit}
tuned_with = {tuned_with}
"""


def tuned_study(study: Study, cells: list[StudyCell], tuned: Mapping[str, str], seed: int, both: bool) -> Study:
    """The study with the tuned label of every estimator; `both`: beside its own label."""
    blocks: dict[tuple[str, tuple[str, ...], str], list[str]] = {}
    for cell in cells:
        labels = [name for label in cell.estimators for name in ((label, tuned[label]) if both else (tuned[label],))]
        baseline = cell.baseline if both else tuned[cell.baseline]
        blocks.setdefault((cell.experiment, tuple(dict.fromkeys(labels)), baseline), []).append(cell.scenario)
    also = tuple(
        Block(scenarios=tuple(scenarios), estimators=labels, baseline=baseline, experiment=experiment)
        for (experiment, labels, baseline), scenarios in blocks.items()
    )
    emptied: dict[str, Any] = {
        "scenarios": (),
        "estimators": (),
        "baseline": "",
        "variants": {},
        "only": (),
        "minutes": None,
    }
    name = f"{study.name}-{'published-and-tuned' if both else 'tuned'}"
    return study.model_copy(update={**emptied, "name": name, "also": also, "tuned_with": seed})


def as_toml(study: Study) -> str:
    """The file's text. A JSON string of printable characters is a TOML string of the same meaning."""
    known = study.model_dump()
    text = HEAD.format(**{key: _text(known[key]) for key in ("about", "trials", "seed", "time_limit", "tuned_with")})
    for block in study.also:
        lines = {key: _text(value) for key, value in block.model_dump().items() if value}
        text += "\n[[also]]\n" + "".join(f"{key} = {value}\n" for key, value in lines.items())
    if study.training:
        text += "\n[training]\n" + "".join(f"{_text(key)} = {_text(value)}\n" for key, value in study.training.items())
    return text


def _text(value: object) -> str:
    if isinstance(value, list | tuple):
        return "[\n" + "".join(f"    {_text(one)},\n" for one in value) + "]" if value else "[]"
    return json.dumps(value, ensure_ascii=False)
