"""`check_estimator`: does an estimator keep to the rules of the comparison?

    assert check_estimator(MyFilter()).passed

`cooploc check NAME` prints the same report, and `parametrize` makes a pytest test of each check; `checks.py` lists the
checks. Modelled on scikit-learn's check_estimator and PettingZoo's API tests.
"""

import sys
from collections.abc import Callable
from dataclasses import replace
from functools import cache, partial
from typing import Any

from cooploc.estimators import is_builtin
from cooploc.estimators.errors import BadInput, nearest
from cooploc.scenarios.conformance.checks import CHECKS, Check
from cooploc.scenarios.conformance.compare import CheckFailed, CheckSkipped
from cooploc.scenarios.conformance.harness import Harness, one_line, raised_by
from cooploc.scenarios.conformance.report import Report, Result, sentences
from cooploc.scenarios.process import SESSION, WorkerError, call
from cooploc.scenarios.runner.run import label_of, make_instance

SMALLER = ((1, 2), (1, 4), (1, 8), (2, 4))  # (trials, ticks) of smaller counterexamples, in the order tried
FIRST = {  # checks without which no other one means anything, and why
    "runs": "it does not run",
    "determinism": "it does not repeat itself, so no two of its runs can be compared",
}
TIME_LIMIT = 600.0  # [s] for all checks of one estimator


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
        return checked_here(estimator, name, seed, only)
    try:
        return checked_there(SESSION, estimator, name, seed, time_limit, only)
    except WorkerError as e:
        return _ended(name or label_of(estimator), seed, str(e))
    except MemoryError as e:
        return _ended(name or label_of(estimator), seed, one_line(e))


def checked_there(
    owner: str, estimator: Any, name: str | None, seed: int, seconds: float, only: str | None = None
) -> Report:
    """The report of checks in a process of this owner; an estimator's name is read there.

    Raises:
        BadInput: as `check_estimator`.
        WorkerError: the process died or took longer than `seconds` of processor time, or the estimator raised what no
            check catches.

    """
    report: Report = call(owner, checked_here, estimator, name, seed, only, seconds=seconds)
    return report


def _ended(name: str, seed: int, why: str) -> Report:
    """The report of checks that did not come to an end."""
    runs, *rest = CHECKS
    remedy = "cooploc check --no-isolate, in a debugger, shows where"
    others = (Result(check.name, "skipped", "it does not run", seed) for check in rest)
    return Report(name, (Result(runs.name, "failed", why, seed, remedy=remedy), *others))


def checked_here(estimator: Any, name: str | None, seed: int, only: str | None = None) -> Report:
    """The report of checks in this process; on a terminal it is said which one runs."""
    harness, results, reason = Harness(name or label_of(estimator), make_instance(estimator), seed), list[Result](), ""
    chosen = [check for check in CHECKS if only in (None, check.name)]
    for k, check in enumerate(chosen):
        _say(f"check {k + 1} of {len(chosen)}: {check.name}")
        if reason:
            results.append(Result(check.name, "skipped", reason, seed))
            continue
        results.append(_with_example(check, run_check(check, harness), harness))
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


def _with_example(check: Check, result: Result, harness: Harness) -> Result:
    """A failure with the smallest stream on which it shows too."""
    if result.status != "failed":
        return result
    for trials, ticks in SMALLER:
        smaller = run_check(check, Harness(harness.name, harness.estimator, harness.seed, trials, ticks))
        if smaller.status == "failed":
            size = f"{trials} trial{'s' * (trials > 1)} of {ticks} ticks"
            return replace(result, example=f"{size}: {smaller.detail}")
    return replace(result, example="no smaller stream shows it")


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
