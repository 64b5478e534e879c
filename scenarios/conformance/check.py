"""`check_estimator`: does an estimator keep to the rules of the comparison?

    assert check_estimator(MyFilter()).passed

`cooploc check NAME` prints the same report, and `parametrize` makes a pytest test of each check; `checks.py` lists the
checks. Modelled on scikit-learn's check_estimator and PettingZoo's API tests.
"""

import sys
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, partial
from typing import Any, Literal

from cooploc.estimators import is_builtin
from cooploc.estimators.errors import BadInput, nearest
from cooploc.scenarios.conformance.checks import CHECKS, Check
from cooploc.scenarios.conformance.harness import CheckFailed, CheckSkipped, Harness, one_line, raised_by
from cooploc.scenarios.display import list_table
from cooploc.scenarios.process import PLUGINS, SESSION, WorkerError, call
from cooploc.scenarios.runner.run import label_of, make_instance

FIRST = {  # checks without which no other one means anything, and why
    "runs": "it does not run",
    "determinism": "it does not repeat itself, so no two of its runs can be compared",
}
TIME_LIMIT = 600.0  # [s] for all checks of one estimator


Status = Literal["passed", "failed", "skipped"]


@dataclass(frozen=True)
class Result:
    """What one check found."""

    check: str
    status: Status
    detail: str  # what was tried and seen, and of a failure where; of a skipped check the reason
    seed: int
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
        """The results as aligned text: a line for each check, and after a failure its remedy."""
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
    """What was found, and of a failure its seed and its remedy."""
    if result.status != "failed":
        return [result.detail]
    remedy = [f"to fix it: {result.remedy}"] if result.remedy else []
    return [f"{result.detail} (seed {result.seed})", *remedy]


def check_estimator(
    estimator: Any,
    name: str | None = None,
    seed: int = 0,
    isolate: bool = True,
    time_limit: float = TIME_LIMIT,
    only: str | None = None,
) -> Report:
    """Run every check on an estimator: it may neither cheat nor break the interface.

    The estimator runs on small simulated streams (3 trials of 12 ticks; 1 and 3 robots), again and again with readings
    perturbed or hidden, packets dropped, trials reordered. A check compares the results and explains a difference.

    Args:
        estimator: its name, a class that needs no arguments, or an instance, as `cooploc.estimators.interface` says.
        name: what to call it in the report; None: its own or its class's name.
        seed: seeds the small streams, and what is done to them; a whole number, 0 or more.
        isolate: False checks it in this process, for a debugger; else one that is not built in has a process of its
            own, where it may crash or hang.
        time_limit: [s] of processor time for all checks in that process; math.inf for none.
        only: the name of the one check to run.

    Returns:
        A report: `passed`, `table()`, and a `Result` for each check, `report["causality"]`.

    Raises:
        BadInput: an unknown name, a class that needs arguments, a check that there is not, or a seed that is not a
            whole number of 0 or more. What the estimator raises while it runs is a failure in the report.

    """
    if only is not None and only not in (known := [check.name for check in CHECKS]):
        raise BadInput(f"there is no check {only!r}; {nearest(only, known)}")
    if not isolate or is_builtin(estimator):
        return _check_here(estimator, name, seed, only)
    try:
        owner = PLUGINS if isinstance(estimator, str) else SESSION  # a file's neighbours are not those of an object
        report: Report = call(owner, _check_here, estimator, name, seed, only, seconds=time_limit)
        return report
    except WorkerError as e:
        return _ended(name or label_of(estimator), seed, str(e))
    except MemoryError as e:
        return _ended(name or label_of(estimator), seed, one_line(e))


def _ended(name: str, seed: int, why: str) -> Report:
    """The report of checks that did not come to an end."""
    runs, *rest = CHECKS
    remedy = "cooploc check --no-isolate, in a debugger, shows where"
    others = (Result(check.name, "skipped", "it does not run", seed) for check in rest)
    return Report(name, (Result(runs.name, "failed", why, seed, remedy=remedy), *others))


def _check_here(estimator: Any, name: str | None, seed: int, only: str | None = None) -> Report:
    """Run the checks in this process; on a terminal it is said which one runs."""
    harness, results, reason = Harness(name or label_of(estimator), make_instance(estimator), seed), list[Result](), ""
    chosen = [check for check in CHECKS if only in (None, check.name)]
    for k, check in enumerate(chosen):
        _say(f"check {k + 1} of {len(chosen)}: {check.name}")
        if reason:
            results.append(Result(check.name, "skipped", reason, seed))
            continue
        results.append(run_check(check, harness))
        reason = FIRST.get(check.name, "") if results[-1].status == "failed" else ""
    _say("")
    return Report(harness.name, tuple(results))


def _say(what: str) -> None:
    """Write over the last line of a terminal; nothing where the output goes elsewhere."""
    if sys.stderr is not None and sys.stderr.isatty():
        print(f"\r{what:<60}", end="" if what else "\r", file=sys.stderr, flush=True)


def parametrize(*estimators: Any, seed: int = 0) -> Any:
    """A pytest mark that makes a test of every check on every estimator; the test calls what it is given.

        @parametrize(MyFilter())
        def test_it_conforms(check):
            check()

    A check that does not apply is skipped, with its reason. Needs pytest.

    Args:
        estimators: instances, as for `check_estimator`.
        seed: as for `check_estimator`.

    """
    import pytest

    cases = []
    for estimator in estimators:
        report = cache(partial(check_estimator, estimator, seed=seed))  # made when the first of its tests runs
        name = type(estimator).__name__
        cases += [pytest.param(partial(_assert_passed, report, c.name), id=f"{name}-{c.name}") for c in CHECKS]
    return pytest.mark.parametrize("check", cases)


def _assert_passed(report: Callable[[], Report], check: str) -> None:
    import pytest

    result = report()[check]
    if result.status == "skipped":
        pytest.skip(result.detail)
    if result.status == "failed":
        pytest.fail("\n".join(sentences(result)), pytrace=False)


def run_check(check: Check, harness: Harness) -> Result:
    """Run one check; whatever the estimator raises is a failure, and what the check itself raises is not.

    Raises:
        BadInput: the harness has a seed that cannot be.

    """
    before = harness.runs
    try:
        seen = check.run(harness)
        detail = f"{seen} ({harness.runs - before} runs)"
        return Result(check.name, "passed", detail, harness.seed, exempt=_exemption(check.name, harness))
    except CheckSkipped as e:
        return Result(check.name, "skipped", str(e), harness.seed)
    except CheckFailed as e:
        return Result(check.name, "failed", str(e), harness.seed, remedy=e.remedy or check.remedy)
    except BadInput:
        raise
    except (Exception, SystemExit, GeneratorExit) as e:
        if not raised_by(e, harness.estimator):
            crash = f"the check itself crashed, which says nothing about the estimator: {one_line(e)}"
            return Result(check.name, "skipped", crash, harness.seed)
        return Result(check.name, "failed", one_line(e), harness.seed, remedy=check.remedy)  # a property of its


def _exemption(check: str, harness: Harness) -> str:
    """What an estimator's own declarations leave out of a check."""
    exempt = {"equivariance": harness.traits.axes and f"axes: {harness.traits.axes}"}
    exempt |= {"immutability": "mutable: its state changes in place" * harness.traits.mutable}
    return exempt.get(check, "")
