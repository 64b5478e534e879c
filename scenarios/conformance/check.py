"""Does an estimator keep to the rules of the comparison? `cooploc check NAME`, and a line in a plug-in's own tests.

    assert check_estimator(MyFilter()).passed

Or one test for each check, with `parametrize`. The models are scikit-learn's check_estimator and PettingZoo's api
tests. What is checked stands in `conformance.py`.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache, partial
from html import escape
from typing import Any, Literal

from cooploc.estimators.plugins.errors import BadInput
from cooploc.scenarios.conformance.checks import CHECKS, Check
from cooploc.scenarios.conformance.harness import Bench, Failed, Skipped, explained

SMALLER = ((1, 2), (1, 4), (1, 8), (2, 4))  # (trials, ticks) of smaller counterexamples, in the order tried
Status = Literal["passed", "failed", "skipped"]


@dataclass(frozen=True)
class Result:
    """What one check found."""

    check: str
    status: Status
    detail: str  # the fact and its place
    seed: int
    example: str = ""  # of a failure, the smallest that was found: how much of which stream shows it


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
        lines = [f"{r.check:{width}}  {r.status:7}  {_told(r)}" for r in self.results]
        return "\n".join([*lines, self.summary()])

    def summary(self) -> str:
        """How many checks ran, passed, failed and were skipped."""
        parts = [f"{self.count('passed')} passed"]
        parts += [f"{self.count(status)} {status}" for status in ("failed", "skipped") if self.count(status)]
        return f"{self.name}: {self.ran} checks ran; {', '.join(parts)}"

    def __repr__(self) -> str:
        return f"Report({self.summary()!r})"

    def _repr_html_(self) -> str:
        cells = [(r.check, r.status, _told(r)) for r in self.results]
        rows = "".join(f"<tr>{''.join(f'<td>{escape(c)}</td>' for c in row)}</tr>" for row in cells)
        head = "<tr><th>check</th><th>result</th><th>what was found</th></tr>"
        return f"<table><caption>{escape(self.summary())}</caption>{head}{rows}</table>"


def _told(result: Result) -> str:
    """What was found, and of a failure its smallest example and its seed."""
    example = f"; smallest: {result.example}" if result.example else ""
    return result.detail + (f"{example} (seed {result.seed})" if result.status == "failed" else "")


def check_estimator(estimator: Any, name: str | None = None, seed: int = 0) -> Report:
    """Run every check on an estimator.

    Args:
        estimator: an instance, built-in or not.
        name: what to call it.
        seed: of the small streams it is tried on, and of what is done to them.

    """
    bench = Bench(name or type(estimator).__name__, estimator, seed)
    runs, *rest = CHECKS
    first = _shrunk(runs, _result(runs, bench), bench)
    if first.status == "passed":
        others = [_shrunk(check, _result(check, bench), bench) for check in rest]
    else:
        others = [Result(_called(check), "skipped", "it does not run", seed) for check in rest]
    return Report(bench.name, (first, *others))


def parametrize(*estimators: Any, seed: int = 0) -> Any:
    """A mark that makes a test of every check on every estimator; the test calls what it is given.

        @parametrize(MyFilter())
        def test_it_conforms(check):
            check()

    What cannot apply is skipped with its reason. Needs pytest.
    """
    import pytest

    cases = []
    for estimator in estimators:
        report = cache(partial(check_estimator, estimator, seed=seed))  # made when the first of its tests runs
        name = type(estimator).__name__
        cases += [pytest.param(partial(_demand, report, _called(c)), id=f"{name}-{_called(c)}") for c in CHECKS]
    return pytest.mark.parametrize("check", cases)


def _demand(report: Callable[[], Report], check: str) -> None:
    import pytest

    result = report()[check]
    if result.status == "skipped":
        pytest.skip(result.detail)
    if result.status == "failed":
        pytest.fail(f"{result.detail} (seed {result.seed})", pytrace=False)


def _shrunk(check: Check, result: Result, bench: Bench) -> Result:
    """A failure with the smallest of some smaller benches on which it shows too."""
    if result.status != "failed":
        return result
    for trials, ticks in SMALLER:
        again = _result(check, Bench(bench.name, bench.estimator, bench.seed, trials, ticks))
        if again.status == "failed":
            size = f"{trials} trial{'s' * (trials > 1)} of {ticks} ticks"
            return replace(result, example=f"{size}: {again.detail}")
    return replace(result, example="none smaller than this was found")


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
