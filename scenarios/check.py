"""Does an estimator keep to the rules of the comparison? `cooploc check NAME`, and a line in a plug-in's own tests.

    assert check_estimator(MyFilter()).passed

The models are scikit-learn's check_estimator and PettingZoo's api tests. What is checked stands in `conformance.py`.
"""

from dataclasses import dataclass
from html import escape
from typing import Any, Literal

from cooploc.estimators.bad_input import BadInput
from cooploc.scenarios.bench import Bench, Failed, Skipped, explained
from cooploc.scenarios.conformance import CHECKS, Check

Status = Literal["passed", "failed", "skipped"]


@dataclass(frozen=True)
class Result:
    """What one check found."""

    check: str
    status: Status
    detail: str  # the fact and its place
    seed: int


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
        """The results as aligned text."""
        width = max((len(r.check) for r in self.results), default=0)
        lines = [f"{r.check:{width}}  {r.status:7}  {r.detail}" for r in self.results]
        return "\n".join([*lines, self.summary()])

    def summary(self) -> str:
        """How many checks ran, passed, failed and were skipped."""
        parts = [f"{self.count('passed')} passed"]
        parts += [f"{self.count(status)} {status}" for status in ("failed", "skipped") if self.count(status)]
        return f"{self.name}: {self.ran} checks ran; {', '.join(parts)}"

    def __repr__(self) -> str:
        return f"Report({self.summary()!r})"

    def _repr_html_(self) -> str:
        cells = [(r.check, r.status, r.detail) for r in self.results]
        rows = "".join(f"<tr>{''.join(f'<td>{escape(c)}</td>' for c in row)}</tr>" for row in cells)
        head = "<tr><th>check</th><th>result</th><th>what was found</th></tr>"
        return f"<table><caption>{escape(self.summary())}</caption>{head}{rows}</table>"


def check_estimator(estimator: Any, name: str | None = None, seed: int = 0) -> Report:
    """Run every check on an estimator.

    Args:
        estimator: an instance, built-in or not.
        name: what to call it.
        seed: of the small streams it is tried on, and of what is done to them.

    """
    bench = Bench(name or type(estimator).__name__, estimator, seed)
    runs, *rest = CHECKS
    first = _result(runs, bench)
    if first.status == "passed":
        others = [_result(check, bench) for check in rest]
    else:
        others = [Result(_called(check), "skipped", "it does not run", seed) for check in rest]
    return Report(bench.name, (first, *others))


def _result(check: Check, bench: Bench) -> Result:
    before = bench.runs
    status: Status = "failed"
    try:
        found = check(bench)
        status, detail = "passed", f"{found} ({bench.runs - before} runs)"
    except Failed as e:
        detail = str(e)
    except Skipped as e:
        status, detail = "skipped", str(e)
    except BadInput:
        raise
    except Exception as e:  # a property of the estimator may fail in any way
        detail = explained(e)
    return Result(_called(check), status, detail, bench.seed)


def _called(check: Check) -> str:
    return check.__name__.replace("_", "-")
