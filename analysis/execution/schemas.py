"""What the JSON files of a run directory hold: one schema each, and one clear reason where something is wrong."""

from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, StrictStr, ValidationError

from cooploc.estimators.errors import first_reason
from cooploc.scenarios.sealed import SEALED, Damaged, parsed, unsealed
from cooploc.scenarios.studies.study import Seed, Study, Trials

FORMAT = SEALED

Count = Annotated[int, Field(strict=True, ge=0)]
Digest = Annotated[str, Field(strict=True, pattern="^[0-9a-f]{64}$")]


class ManifestCell(BaseModel):
    """What was asked of a scenario."""

    experiment: StrictStr
    baseline: StrictStr
    estimators: dict[StrictStr, Trials]


class CheckResult(BaseModel):
    """One check of a certificate."""

    model_config = ConfigDict(extra="allow")

    check: StrictStr
    status: StrictStr
    detail: StrictStr
    example: StrictStr | None = None


class Certificate(BaseModel):
    """What was found of an estimator that is not built in."""

    model_config = ConfigDict(extra="allow")

    status: Literal["passed", "failed", "unchecked"]
    found: StrictStr
    checks: list[CheckResult]
    source: dict[StrictStr, StrictStr]
    trained_on: StrictStr = ""


class Versions(BaseModel):
    """Of Python and of packages."""

    model_config = ConfigDict(extra="allow")

    cooploc: StrictStr
    python: StrictStr

    __pydantic_extra__: dict[str, StrictStr]


class Manifest(BaseModel):
    """`manifest.json`: what was asked, and what the bits of the results depend on."""

    model_config = ConfigDict(extra="allow")

    format: Literal[1, 2]
    study: Study
    cells: dict[StrictStr, ManifestCell]
    seed: Seed
    data: StrictStr | None
    scenarios: dict[StrictStr, dict[StrictStr, Any]]
    files: dict[StrictStr, StrictStr] = {}
    imports: dict[StrictStr, dict[StrictStr, StrictStr]] = {}  # plug-in -> distribution -> version
    certificates: dict[StrictStr, Certificate] = {}
    streams: dict[StrictStr, dict[StrictStr, StrictStr]]
    versions: Versions
    source: StrictStr
    instructions: dict[StrictStr, StrictStr] = {}  # earlier versions did not note them
    isolated: bool = True
    commit: StrictStr | None
    cpu: StrictStr


class OldReceipt(BaseModel):
    """A receipt of format 1."""

    model_config = ConfigDict(extra="forbid")

    seconds: Annotated[float, Field(strict=True)]
    sha256: Digest


class Receipt(OldReceipt):
    """What is known of a part beside its rows."""

    format: Literal[2]
    settings: Digest  # of what its bits depend on: `run_directory.settings`
    failed: Count  # trials of it that failed


class SampledTrial(BaseModel):
    """What a report says of one trial of one estimator."""

    model_config = ConfigDict(extra="forbid")

    scenario: StrictStr
    estimator: StrictStr
    trial: Annotated[int, Field(strict=True, ge=0, lt=1_000_000)]
    stream: StrictStr
    digest: Digest
    rmse: Annotated[float, Field(strict=True)] | None
    failure: StrictStr | None


class PageData(BaseModel):
    """What the page of a report embeds, to run some of its trials again."""

    format: Literal[1, 2] = 1
    manifest: Manifest
    sample: list[SampledTrial]


def checked(text: str | bytes, schema: type[BaseModel]) -> dict[str, Any]:
    """A JSON object as it was written, without its checksum.

    Raises:
        Damaged: it is not what was written, or not of this schema.
        Newer: it was written by a newer version.

    """
    content = parsed(text)
    for written in (content.get("format"), *_of(content.get("manifest"))):
        if isinstance(written, int) and not isinstance(written, bool) and written > FORMAT:
            raise Newer(f"format {written}, this version reads up to {FORMAT}: update cooploc")
    held = unsealed(content)
    demand(schema, held)
    return held


def _of(manifest: object) -> list[Any]:
    """The format of the manifest that a page embeds."""
    return [manifest.get("format")] if isinstance(manifest, dict) else []


def demand(schema: type[BaseModel], content: Any) -> None:
    """Refuse what a schema does not allow.

    Raises:
        Damaged: says where, and why.

    """
    try:
        schema.model_validate(content)
    except ValidationError as e:
        raise Damaged(first_reason(e.errors())) from None


class Newer(ValueError):
    """Written by a newer version."""
