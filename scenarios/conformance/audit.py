"""Watches every call of an estimator's methods, so that none writes to what it is given."""

from typing import Any

from cooploc.scenarios.conformance.snapshot import require_unchanged, snapshot
from cooploc.scenarios.runner.tick import Watcher

BEFORE = ("prior", "world", "rows")
ARGUMENTS = {"init": BEFORE, "smooth": (*BEFORE, "senses", "mail")}  # of a method; of others state, senses, mail


def audited(scenario: str, mutable: bool, watch: Watcher) -> Watcher:
    """Compares everything that a method is given before and after the call."""

    def audit(method: str, tick: int, arguments: tuple[Any, ...], call: Any) -> Any:
        names = ARGUMENTS.get(method, ("state", "senses", "mail"))
        seen = [i for i in range(len(arguments)) if not (mutable and names[i] == "state")]
        before = [snapshot(arguments[i], names[i]) for i in seen]
        result = watch(method, tick, arguments, call)
        for i, old in zip(seen, before, strict=True):
            when = f"by {method}() at tick {tick} of {scenario!r}"
            require_unchanged(old, snapshot(arguments[i], names[i]), when)
        return result

    return audit
