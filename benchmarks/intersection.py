"""How long the weights of covariance intersection take: by cvxpy in five ways, and exactly.

Run: python benchmarks/intersection.py [rounds]. All contenders solve the same 100 fusions in one process, turn by turn;
medians over the rounds of processor time are printed, ratios with their spread, and how far the answers differ. `fresh`
is what one writes first: log_det or tr_inv, and inv_pos for a relative measurement. `cone` is the second-order cone
program of one fusion, the fastest that a fresh problem can be. `asked` is one such problem with cvxpy's parameters,
solved by `Problem.solve`. `alone`, `stacked` and `exact` are `weights(...)`: a program for each fusion, as CTRN takes
them, one program for all, and no solver.
"""

import sys
from collections.abc import Callable
from time import process_time
from typing import Any

import cvxpy as cp
import numpy as np

from cooploc.estimators.covariance_intersection.weights import intersect, relative_weights, weights
from cooploc.estimators.ctrn.chain import chain
from cooploc.estimators.interface import Belief
from cooploc.estimators.models.sensors import Range

FUSIONS = 100
ALONE = np.arange(FUSIONS)  # each fusion a group of its own
FRESH = 10  # of them are solved by the slow contenders in a round
REPEAT = 20  # times the fast one solves them
CASES = [(m, 2, criterion) for m in (2, 5, 10) for criterion in ("det", "trace")] + [(2, 3, "trace"), (5, 3, "det")]


def fresh(P: Any, criterion: str) -> Any:
    A = np.linalg.inv(P)
    w = cp.Variable(len(P), nonneg=True)
    X = sum(w[k] * A[k] for k in range(len(P)))
    aim = cp.Maximize(cp.log_det(X)) if criterion == "det" else cp.Minimize(cp.tr_inv(X))
    cp.Problem(aim, [cp.sum(w) == 1]).solve(solver="CLARABEL")
    return w.value


def entries(P: Any) -> Any:
    """Three rows (3, m): what the information of each source has at 11, 12 and 22, in the unit of their mean trace."""
    A = np.linalg.inv(P)
    return A[:, (0, 0, 1), (0, 1, 1)].T / np.trace(A.mean(0))


def cone_problem(A: Any, criterion: str) -> Any:
    """The problem, and its weights, of numbers or parameters A (3, m)."""
    w, t = cp.Variable(A.shape[1], nonneg=True), cp.Variable()
    a, b, c = A[0] @ w, A[1] @ w, A[2] @ w
    if criterion == "det":
        aim, inside = t, cp.SOC(a + c, cp.hstack([2 * b, 2 * t, a - c]))
    else:
        u, v = (a + c) / 2, (a - c) / 2
        aim, inside = u - t, cp.SOC(u + t, cp.hstack([2 * v, 2 * b, u - t]))
    return cp.Problem(cp.Maximize(aim), [inside, cp.sum(w) == 1]), w


def cone(P: Any, criterion: str) -> Any:
    problem, w = cone_problem(entries(P), criterion)
    problem.solve(solver="CLARABEL")
    return w.value


def asker(m: int, criterion: str) -> Callable[[Any], Any]:
    """What `cone` answers, of one problem whose numbers change."""
    A = cp.Parameter((3, m))
    problem, w = cone_problem(A, criterion)

    def ask(P: Any) -> Any:
        A.value = entries(P)
        problem.solve(solver="CLARABEL", warm_start=False)
        return w.value

    return ask


def fresh_relative(P_i: Any, P_j: Any, H_i: Any, H_j: Any, R: Any, criterion: str) -> Any:
    """science.md: (1-w) / (q + R (1-w)) = 1/R - (q/R) inv_pos(q + R (1-w))."""
    q, r, A = (H_j @ P_j @ H_j.T).item(), R.item(), np.linalg.inv(P_i)
    w, n = cp.Variable(nonneg=True), cp.Variable()
    X = w * A + n * (H_i.T @ H_i)
    aim = cp.Maximize(cp.log_det(X)) if criterion == "det" else cp.Minimize(cp.tr_inv(X))
    cp.Problem(aim, [w <= 1, n <= 1 / r - q / r * cp.inv_pos(q + r * (1 - w))]).solve(solver="CLARABEL")
    return w.value


def seconds(function: Callable[[], object], fusions: int, repeat: int = 1) -> float:
    """Per fusion."""
    start = process_time()
    for _ in range(repeat):
        function()
    return (process_time() - start) / repeat / fusions


def race(contenders: dict[str, tuple[Callable[[], object], int, int]], rounds: int) -> dict[str, Any]:
    """Seconds per fusion (rounds,) of each contender (function, fusions, repeat), after one round to compile."""
    for function, _, _ in contenders.values():
        function()
    times: dict[str, list[float]] = {name: [] for name in contenders}
    for _ in range(rounds):
        for name, (function, fusions, repeat) in contenders.items():
            times[name].append(seconds(function, fusions, repeat))
    return {name: np.array(t) for name, t in times.items()}


def show(case: str, times: dict[str, Any], differences: tuple[float, ...]) -> None:
    def us(name: str) -> str:
        return f"{1e6 * np.median(times[name]):>8.4g}" if name in times else f"{'':>8}"

    columns = [f"{case:<21}", us("fresh"), us("cone"), us("asked")]
    for name in ("alone", "stacked", "exact"):
        ratio = times["fresh"] / times[name]
        spread = f"{np.median(ratio):.0f} ({ratio.min():.0f}-{ratio.max():.0f})"
        over_asked = f"{np.median(times['asked'] / times[name]):.0f}" if "asked" in times else ""
        columns += [us(name), f"{spread:>21}", f"{over_asked:>8}"]
    print("".join(columns), *(f"{x:>7.0e}" for x in differences), flush=True)


def absolute(m: int, d: int, criterion: Any, rounds: int) -> None:
    a = np.random.default_rng(1).normal(size=(FUSIONS, m, d, d))
    P = a @ a.mT + 0.1 * np.eye(d)
    ask = asker(m, criterion)
    contenders: dict[str, Any] = {
        "fresh": (lambda: [fresh(p, criterion) for p in P[:FRESH]], FRESH, 1),
        "cone": (lambda: [cone(p, criterion) for p in P[:FRESH]], FRESH, 1),
        "asked": (lambda: [ask(p) for p in P[:FRESH]], FRESH, 1),
        "alone": (lambda: weights(P, criterion, "cvxpy", ALONE), FUSIONS, 3),
        "stacked": (lambda: weights(P, criterion, "cvxpy"), FUSIONS, 3),
        "exact": (lambda: weights(P, criterion, "exact"), FUSIONS, REPEAT),
    }
    if d != 2:
        del contenders["cone"], contenders["asked"]
    times = race(contenders, rounds)
    w = {solver: weights(P, criterion, solver) for solver in ("cvxpy", "exact")}
    Q = {solver: intersect(np.zeros(P.shape[:3]), P, w[solver])[1] for solver in w}
    size = {solver: np.linalg.det(Q[solver]) if criterion == "det" else np.trace(Q[solver], 0, 1, 2) for solver in w}
    away = np.abs(w["exact"][:FRESH] - [fresh(p, criterion) for p in P[:FRESH]]).max()
    worse = np.abs(size["cvxpy"] / size["exact"] - 1).max()
    show(f"{m} sources, d={d}, {criterion}", times, (worse, np.abs(w["cvxpy"] - w["exact"]).max(), away))


def relative(criterion: Any, rounds: int) -> None:
    rng = np.random.default_rng(2)
    a = rng.normal(size=(2, FUSIONS, 2, 2))
    P_i, P_j = a @ a.mT + 0.1 * np.eye(2)
    P_j, R = 0.05 * P_j, np.full((1, 1), 0.01)
    H = rng.normal(size=(FUSIONS, 1, 2))
    H /= np.linalg.norm(H, axis=-1, keepdims=True)

    def slow() -> list[Any]:
        return [fresh_relative(P_i[f], P_j[f], H[f], -H[f], R, criterion) for f in range(FRESH)]

    def fast(solver: Any, groups: Any = None) -> Any:
        return relative_weights(P_i, P_j, H, -H, R, criterion, solver, groups=groups)

    times = race(
        {
            "fresh": (slow, FRESH, 1),
            "alone": (lambda: fast("cvxpy", ALONE), FUSIONS, 3),
            "stacked": (lambda: fast("cvxpy"), FUSIONS, 3),
            "exact": (lambda: fast("exact"), FUSIONS, REPEAT),
        },
        rounds,
    )
    away = np.abs(fast("exact")[:FRESH] - slow()).max()
    show(f"range, d=2, {criterion}", times, (np.nan, np.abs(fast("cvxpy") - fast("exact")).max(), away))


def chained(senders: int, rounds: int) -> None:
    """Whole fusions by range, update and sampling included, of rows that hear so many senders."""
    rng = np.random.default_rng(3)
    a = rng.normal(size=(FUSIONS, 1 + senders, 2, 2))
    P, x = 0.1 * (a @ a.mT + 0.1 * np.eye(2)), rng.uniform(0, 20, (FUSIONS, 1 + senders, 2))
    packets = np.concatenate([x, P[..., 0, :], P[..., 1, 1:]], -1)[:, 1:]
    z = np.linalg.norm(x[:, 1:] - x[:, :1], axis=-1) + 0.1 * rng.normal(size=(FUSIONS, senders))
    recorded = rng.uniform(size=z.shape) < 1e-3

    def whole() -> object:
        return chain(Belief(x[:, 0], P[:, 0]), Range(), packets, z, "trace", recorded)

    seconds_each = race({"chain": (whole, FUSIONS * senders, REPEAT)}, rounds)["chain"]
    print(f"{'chain of ' + str(senders):<21}{1e6 * np.median(seconds_each):>8.4g} us a fusion, all of it", flush=True)


def main(rounds: int = 7) -> None:
    print(f"microseconds per fusion of {FUSIONS}; ratios: median of {rounds} rounds (least-most); differences of the")
    print("criterion and of weights between stacked and exact, and of weights between fresh and exact")
    head = "".join(f"{name:>8}{'x fresh':>21}{'x asked':>8}" for name in ("alone", "stacked", "exact"))
    print(f"{'':<21}{'fresh':>8}{'cone':>8}{'asked':>8}{head}  crit     dw      dw(fresh)")
    for m, d, criterion in CASES:
        absolute(m, d, criterion, rounds)
    for criterion in ("trace", "det"):
        relative(criterion, rounds)
    for senders in (2, 20, 98):
        chained(senders, rounds)


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
