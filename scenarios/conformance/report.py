"""What checks found: a line for each, in a terminal and in a notebook."""

from dataclasses import dataclass
from typing import Literal

from cooploc.scenarios.display import list_table

Status = Literal["passed", "failed", "skipped"]


@dataclass(frozen=True)
class Result:
    """What one check found."""

    check: str
    status: Status
    detail: str  # what was tried and seen, and of a failure where; of a skipped check the reason
    seed: int
    example: str = ""  # of a failure, on the smallest stream that shows it
    remedy: str = ""  # of a failure, what to change
    exempt: str = ""  # of a check that passed in part, what it left out and why


@dataclass(frozen=True, repr=False)
class Report:
    """What all checks found."""

    name: str
    results: tuple[Result, ...]

    @property
    def passed(self) -> bool:
        """Some checks ran, and none failed."""
        return self.ran > 0 and self.count("failed") == 0

    @property
    def ran(self) -> int:
        """How many checks ran."""
        return len(self.results) - self.count("skipped")

    def count(self, status: Status) -> int:
        """How many checks ended so."""
        return sum(r.status == status for r in self.results)

    def __getitem__(self, check: str) -> Result:
        for r in self.results:
            if r.check == check:
                return r
        raise KeyError(check)

    def table(self) -> str:
        """The results as aligned text: a line for each check, and after a failure its example and remedy."""
        width = max((len(r.check) for r in self.results), default=0)
        indent = "\n" + " " * (width + 11)
        lines = [f"{r.check:{width}}  {r.status:7}  {indent.join(sentences(r))}" for r in self.results]
        return "\n".join([*lines, self.summary()])

    def summary(self) -> str:
        """How many checks ran, passed, failed and were skipped."""
        parts = [f"{self.count('passed')} passed"]
        parts += [f"{self.count(status)} {status}" for status in ("failed", "skipped") if self.count(status)]
        return f"{self.name}: {self.ran} check{'s' * (self.ran != 1)} ran; {', '.join(parts)}"

    def __repr__(self) -> str:
        return f"Report({self.summary()!r})"

    def _repr_html_(self) -> str:
        rows = [(r.check, r.status, "; ".join(sentences(r))) for r in self.results]
        return list_table(("check", "result", "what was found"), self.summary(), rows)


def sentences(result: Result) -> list[str]:
    """What was found, and of a failure its seed, its smallest example and its remedy."""
    if result.status != "failed":
        return [result.detail]
    example = [f"smallest example: {result.example}"] if result.example else []
    remedy = [f"to fix it: {result.remedy}"] if result.remedy else []
    return [f"{result.detail} (seed {result.seed})", *example, *remedy]
