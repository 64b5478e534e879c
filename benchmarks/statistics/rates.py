"""Proves the statistics by simulation: worlds whose truth is known, and how often intervals and verdicts are right.

    python benchmarks/statistics/rates.py reports/statistics.md

Ends with 1 where a rate misses what the documentation promises. Every cell draws from its own seed, so the report is
the same whenever it is made.
"""

import sys
import time
import zlib
from collections.abc import Callable
from functools import partial
from itertools import combinations
from pathlib import Path

import numpy as np
import pandas as pd
from loky import get_reusable_executor
from scipy import stats

from cooploc.analysis.claims.kinds import FALLS, KINDS, Claim, cases, decide
from cooploc.analysis.claims.trial_table import TrialTable
from cooploc.analysis.metrics import statistics
from cooploc.analysis.metrics.compare import mark_outliers
from cooploc.analysis.metrics.consistency import flag
from cooploc.analysis.metrics.ranking import SEPARATED, board_letters, letters
from cooploc.analysis.metrics.statistics import FIXED

TRIALS = (10, 30, 100)
REPEATS = 2000
TICKS, MEMORY = 50, 0.9
FAMILY = 20  # comparisons in one table
BOARDS = 1000
SKEWS = {"equal skew: log-sd 0.4": [0.4] * 10, "unequal skew: five 0.4, five 1.0": [0.4] * 5 + [1.0] * 5}
HEAVY_MEAN = 2 * np.sqrt(3) / np.pi  # of |t| with three degrees of freedom

Rows = dict[str, list[float]]
Draw = Callable[[np.random.Generator, tuple[int, ...]], np.ndarray]


def normal(rng: np.random.Generator, shape: tuple[int, ...]) -> np.ndarray:
    """Mean squared errors (..., trial, column) of mean 1 that are normal; hard trials are hard for all columns."""
    shared = rng.normal(size=(*shape[:-1], 1))
    return 1 + 0.1 * shared + 0.1 * rng.normal(size=shape)


def lognormal(rng: np.random.Generator, shape: tuple[int, ...]) -> np.ndarray:
    """The same, skewed: the logarithm has standard deviation 0.5."""
    shared = rng.normal(0, 0.4, (*shape[:-1], 1))
    return np.exp(shared + rng.normal(0, 0.3, shape) - 0.125)


def heavy(rng: np.random.Generator, shape: tuple[int, ...]) -> np.ndarray:
    """The same with heavy tails: |t| of three degrees of freedom, whose third moment does not exist."""
    shared = rng.normal(0, 0.4, (*shape[:-1], 1))
    return np.exp(shared - 0.08) * np.abs(rng.standard_t(3, shape)) / HEAVY_MEAN


WORLDS: dict[str, Draw] = {"normal": normal, "lognormal": lognormal, "heavy": heavy}
HEADS = [f"{world} {n}" for world in WORLDS for n in TRIALS]


def slack(repeats: int) -> float:
    """Three standard errors of a rate of 0.05."""
    return 3 * np.sqrt(0.05 * 0.95 / repeats)


class Report:
    """Collects tables and broken promises."""

    def __init__(self) -> None:
        self.lines: list[str] = []
        self.broken: list[str] = []

    def table(
        self, title: str, about: str, rows: Rows, promise: tuple[float, float] = (0.0, 0.05), repeats: int = REPEATS
    ) -> None:
        """Add rows of rates, a column per world and trials, or per trials; one that misses its promise is in bold.

        `repeats` are those of the slowest row. Rows in brackets and heavy tails are not promised.
        """
        heads = HEADS if len(next(iter(rows.values()))) == len(HEADS) else [f"{n}" for n in TRIALS]
        self.lines += ["", f"## {title}", "", about, ""]
        self.lines += ["| | " + " | ".join(heads) + " |", "|---" * (len(heads) + 1) + "|"]
        low, high = promise
        for name, rates in rows.items():
            cells = []
            for head, rate in zip(heads, rates, strict=True):
                missed = not low - slack(repeats) <= rate <= high + slack(repeats)
                promised = not head.startswith("heavy") and not name.startswith("(")
                if missed and promised:
                    self.broken.append(f"{title}: {name}, {head}: {rate:.3f}, promised {low} to {high}")
                cells.append(f"**{rate:.3f}**" if missed else f"{rate:.3f}")
            self.lines.append(f"| {name} | " + " | ".join(cells) + " |")


def rates(name: str, measure: Callable[[np.random.Generator, Draw, int], float]) -> list[float]:
    """One rate per world and number of trials, over two processes."""
    cells = [(f"{name} {world} {n}", draw, n) for world, draw in WORLDS.items() for n in TRIALS]
    generators = [np.random.default_rng(zlib.crc32(text.encode())) for text, _, _ in cells]
    return list(get_reusable_executor(2).map(lambda rng, cell: measure(rng, *cell[1:]), generators, cells))


def covered(intervals: list[statistics.Interval], truth: float) -> float:
    """The share of intervals that hold the truth; one that does not exist holds nothing."""
    return float(np.mean([low <= truth <= high for _, low, high in intervals]))


# ------------ coverage


def of_change(interval: Callable[..., statistics.Interval], repeats: int = REPEATS):
    """Coverage of a true change of sqrt(0.5) - 1."""

    def measure(rng: np.random.Generator, draw: Draw, n: int) -> float:
        pairs = draw(rng, (repeats, n, 2)) * [1.0, 0.5]
        return covered([interval(a, b) for a, b in pairs.swapaxes(1, 2)], np.sqrt(0.5) - 1)

    return measure


def unequal(spread: float) -> list[float]:
    """Coverage of the change of two equal means, whose errors are lognormal with log-sd 0.4 and `spread`."""
    out = []
    for n in TRIALS:
        rng = np.random.default_rng([n, int(10 * spread)])
        logs = rng.normal(size=(REPEATS, 2, n)) * np.array([[0.4], [spread]])
        pairs = np.exp(logs - np.array([[0.4], [spread]]) ** 2 / 2)
        out.append(covered([FIXED.change(a, b) for a, b in pairs], 0.0))
    return out


def of_mean(interval: Callable[..., statistics.Interval]):
    """Coverage of a mean of 1."""

    def measure(rng: np.random.Generator, draw: Draw, n: int) -> float:
        return covered([interval(v[:, 0]) for v in draw(rng, (REPEATS, n, 1))], 1.0)

    return measure


def of_difference(rng: np.random.Generator, draw: Draw, n: int) -> float:
    """The mean difference of RMSE; its truth is that of a million draws."""
    truth = np.sqrt(draw(rng, (1_000_000, 1))).mean() * (np.sqrt(0.5) - 1)
    pairs = np.sqrt(draw(rng, (REPEATS, n, 2)) * [1.0, 0.5])
    return covered([FIXED.mean(b - a) for a, b in pairs.swapaxes(1, 2)], truth)


def of_interaction(rng: np.random.Generator, draw: Draw, n: int) -> float:
    """A ratio of ratios."""
    values = draw(rng, (REPEATS, n, 4)) * [1.5, 1.0, 1.0, 1.0]
    weights = np.array([1, -1, -1, 1]) / 2
    return covered([FIXED.log_contrast(v, weights) for v in values], np.log(1.5) / 2)


def of_share(p: float, together: float) -> list[float]:
    """Wilson's interval of the share p of five robots that diverge, all of a trial at once with this probability."""
    out = []
    for n in TRIALS:
        rng = np.random.default_rng([n, int(100 * p), int(10 * together)])
        team = (rng.uniform(size=(REPEATS, n, 1)) < p).repeat(5, -1)
        at_once = rng.uniform(size=(REPEATS, n, 1)) < together
        robots = np.where(at_once, team, rng.uniform(size=(REPEATS, n, 5)) < p)
        out.append(covered([statistics.share(r) for r in robots.mean(-1)], p))
    return out


RARE = "(coverage)", "(warned)", "(coverage where not warned)"


def rare(n: int) -> tuple[float, float, float]:
    """Of RMSE where one trial of a hundred errs twentyfold: coverage; the share that is warned of; coverage without it.

    Of n trials, (1 - 0.01)^n repetitions have seen no such trial, and nothing can tell.
    """
    rng = np.random.default_rng([20, n])
    values = lognormal(rng, (REPEATS, n, 1))[..., 0] * np.where(rng.uniform(size=(REPEATS, n)) < 0.01, 400.0, 1.0)
    truth = 0.99 + 0.01 * 400.0
    held = np.array([low <= truth <= high for _, low, high in map(FIXED.mean_of_positive, values)])
    warned = np.array([mark_outliers(v).any() for v in values])
    return float(held.mean()), float(warned.mean()), float(held[~warned].mean()) if (~warned).any() else 1.0


# ------------ A/A and ties


def one_test(rng: np.random.Generator, draw: Draw, n: int) -> float:
    """The test of the change of RMSE, of two equals."""
    pairs = draw(rng, (REPEATS, n, 2))
    return float(np.mean([FIXED.p_of_difference(a, b) < 0.05 for a, b in pairs.swapaxes(1, 2)]))


def disagreeing(rng: np.random.Generator, draw: Draw, n: int) -> float:
    """How often p and the interval of the change do not say the same of two that differ by 20 %."""
    pairs = draw(rng, (REPEATS, n, 2)) * [1.0, 0.8**2]
    found = [(FIXED.p_of_difference(a, b), FIXED.change(a, b)) for a, b in pairs.swapaxes(1, 2)]
    return float(np.mean([(p < 0.05) != (low > 0 or high < 0) for p, (_, low, high) in found]))


def families(adjust: Callable[[np.ndarray], np.ndarray]):
    """Share of tables of equals in which anything is called different."""

    def measure(rng: np.random.Generator, draw: Draw, n: int) -> float:
        wrong = []
        for _ in range(REPEATS // 4):
            values = draw(rng, (n, FAMILY + 1))
            p = stats.ttest_1samp(values[:, 1:] - values[:, :1], 0, axis=0).pvalue
            wrong.append((adjust(p) < 0.05).any())
        return float(np.mean(wrong))

    return measure


def boards(spread: list[float], letter: Callable[[pd.DataFrame], dict[str, str]]) -> list[float]:
    """Share of boards of ten equals, lognormal with these standard deviations, in which any two share no letter.

    Half of the logarithm's variance is the trial's, hard or easy for all ten.
    """
    out, s = [], np.array(spread)
    for n in TRIALS:
        rng = np.random.default_rng([n, *(10 * s).astype(int)])
        logs = s * np.sqrt(0.5) * (rng.normal(size=(BOARDS, n, 1)) + rng.normal(size=(BOARDS, n, 10))) - s**2 / 2
        marks = [letter(pd.DataFrame(np.exp(one), columns=list("abcdefghij"))).values() for one in logs]
        out.append(float(np.mean([any(not {*a} & {*b} for a, b in combinations(each, 2)) for each in marks])))
    return out


def ties(rng: np.random.Generator, draw: Draw, n: int) -> float:
    """Equivalence within 10 % of two whose RMSE differ by exactly 10 %."""
    pairs = draw(rng, (REPEATS, n, 2)) * [1.0, 1.1**2]
    return float(np.mean([statistics.equivalence(a, b, 0.1) < 0.05 for a, b in pairs.swapaxes(1, 2)]))


# ------------ verdicts

SIX = [f"s/n={k}" for k in range(1, 7)]
ONE, TWO = SIX[:1], SIX[:2]
BOTH = ("supported", "contradicted")


def beside_b(*factors: float) -> np.ndarray:
    """Factors of the true mean squared errors (scenario, estimator), of an estimator beside one whose are 1."""
    return np.stack([np.array(factors), np.ones(len(factors))], 1)


# what is claimed and what is true -> the claim, the factors, the false verdicts
LIES: dict[str, tuple[dict[str, object], np.ndarray, tuple[str, ...]]] = {
    "better; they are equal": ({"kind": "change", "than": ("b",), "scenarios": ONE}, beside_b(1.0), BOTH),
    "30 % better (less 5); it is 25 %": (
        {"kind": "change", "than": ("b",), "scenarios": ONE, "size": -0.3}, beside_b(0.75**2), BOTH
    ),
    "30 % better; it is 30 %": (
        {"kind": "change", "than": ("b",), "scenarios": ONE, "size": -0.3},
        beside_b(0.7**2),
        ("direction only", "contradicted"),
    ),
    "better everywhere; once they are equal": (
        {"kind": "all", "than": ("b",), "scenarios": SIX}, beside_b(1.0, *[0.25] * 5), BOTH
    ),
    "better everywhere; they are equal": ({"kind": "all", "than": ("b",), "scenarios": SIX}, np.ones((6, 2)), BOTH),
    "same within 10 %; once it is 10 % more": (
        {"kind": "same", "scenarios": SIX, "margin": 0.1}, beside_b(*[1.0] * 5, 1.21), BOTH
    ),
    "same within 10 %; all are 10 % more than the first": (
        {"kind": "same", "scenarios": SIX, "margin": 0.1}, beside_b(1.0, *[1.21] * 5), BOTH
    ),
    "grows; it does not": ({"kind": "growth", "scenarios": SIX}, np.ones((6, 2)), BOTH),
    "flat within 10 % over the sweep; it grows by 10 %": (
        {"kind": "growth", "scenarios": SIX, "margin": 0.1},
        beside_b(*1.21 ** (np.arange(6) / 5)),
        ("flat", "contradicted"),
    ),
    "loses more; it loses as much": (
        {"kind": "interaction", "than": ("b",), "scenarios": TWO}, np.array([[1.0, 1.0], [2.0, 2.0]]), BOTH
    ),
    "at most 1 m; it is 1 m": ({"kind": "level", "scenarios": ONE, "size": 1.0}, np.ones((1, 2)), BOTH),
}  # fmt: skip


def lie(told: dict[str, object], factors: np.ndarray, false: tuple[str, ...]):
    """How often a claim gets a verdict that is not true."""
    claim = Claim(id="x", says="", of="a", **told)  # type: ignore[arg-type]
    judge, (case, *_) = KINDS[claim.kind].judge, cases(claim)
    assert judge is not None

    def measure(rng: np.random.Generator, draw: Draw, n: int) -> float:
        wrong = 0
        for _ in range(REPEATS):
            values = draw(rng, (n, factors.size)).reshape(n, *factors.shape) * factors
            frames = {
                (label, name): pd.DataFrame({"mse": values[:, i, j]})
                for i, label in enumerate(case.scenarios)
                for j, name in enumerate("ab")
            }
            wrong += judge(case, claim, TrialTable(frames, {}, set())).verdict in false
        return wrong / REPEATS

    return measure


def ledgers(standing: bool):
    """Share of ledgers of claims that one is better, all of equals, in which a verdict is decided, or stands."""

    def measure(rng: np.random.Generator, draw: Draw, n: int) -> float:
        wrong = []
        for _ in range(REPEATS // 4):
            values = draw(rng, (n, FAMILY + 1))
            a = values[:, 0]
            found = [FIXED.change(a, b) for b in values[:, 1:].T]
            tests = (partial(FIXED.p_of_change, a, b) for b in values[:, 1:].T)
            p = np.array([decide(one, n, FALLS, test).p for one, test in zip(found, tests, strict=True)])
            wrong.append(bool(((statistics.holm(p) if standing else p) <= 0.05).any()))
        return float(np.mean(wrong))

    return measure


def overlooked(rng: np.random.Generator, draw: Draw, n: int) -> float:
    """Share of false verdicts on `FAMILY` equals that `expected_false` did not foresee: 0 where it foresees enough."""
    false, foreseen = 0, 0.0
    for _ in range(REPEATS // 4):
        values = draw(rng, (n, FAMILY + 1))
        p = np.array([FIXED.p_of_change(values[:, 0], b, 0.0) for b in values[:, 1:].T])
        false, foreseen = false + int((p <= 0.05).sum()), foreseen + statistics.expected_false(p)
    return max(0.0, 1 - foreseen / false) if false else 0.0


# ------------ flags


def flagged(too_small: float, words: tuple[str, ...]) -> list[float]:
    """How often Gaussian errors with memory, whose covariance is told too small by a factor, get one of the words."""
    out = []
    for n in TRIALS:
        rng = np.random.default_rng(zlib.crc32(f"flagged {too_small} {n}".encode()))
        x, nees, inside = rng.normal(size=(REPEATS, n, 2)), np.zeros((REPEATS, n)), np.zeros((REPEATS, n))
        for _ in range(TICKS):
            d2 = too_small * (x**2).sum(-1)
            nees += d2 / 2 / TICKS
            inside += (d2 <= stats.chi2.ppf(0.95, 2)) / TICKS
            x = MEMORY * x + np.sqrt(1 - MEMORY**2) * rng.normal(size=x.shape)
        found = [flag(n, FIXED.mean_of_positive(a), FIXED.mean(c)) for a, c in zip(nees, inside, strict=True)]
        out.append(float(np.mean([word in words for word in found])))
    return out


def main() -> int:
    """Measure everything, write the report, say what was promised and missed."""
    began, report = time.perf_counter(), Report()
    report.lines += HEADER.strip().splitlines()
    report.table(
        "Coverage of 95 % intervals",
        "Share of repetitions whose interval holds the truth; where there is none, it does not. "
        "Promised: 0.92 to 0.98. Rows in brackets are for comparison, and not promised.",
        {
            "change, jackknife on log ratio": rates("change", of_change(FIXED.change)),
            "RMSE, ANEES: jackknife on log mean": rates("positive", of_mean(FIXED.mean_of_positive)),
            "(the same, all trials counted alike)": rates("even", of_mean(FIXED._replace(trials=len).mean_of_positive)),
            "(the t interval in its place)": rates("plain", of_mean(FIXED.mean)),
            "difference of RMSE, t": rates("difference", of_difference),
            "ratio of ratios, jackknife": rates("interaction", of_interaction),
        },
        (0.92, 0.98),
    )
    report.table(
        "Coverage where one errs erratically",
        "Two with equal mean squared errors, lognormal: the logarithm has standard deviation 0.4 for one, and that of "
        "the row for the other. Promised: 0.92 to 0.98 up to 1.2. Beyond it few trials do not show the large errors "
        "that make the mean.",
        {"change, 0.8": unequal(0.8), "change, 1.2": unequal(1.2), "(change, 1.5)": unequal(1.5)},
        (0.92, 0.98),
    )
    report.table(
        "Coverage of shares",
        "Wilson's interval over effective trials, for a share of robots that diverge: five robots, each on its own or "
        "all of a trial at once. Promised: at least 0.90.",
        {
            f"{100 * p:.0f} %, {'all at once' if together else 'each on its own'}": of_share(p, together)
            for p in (0.05, 0.3)
            for together in (0.0, 1.0)
        },
        (0.90, 1.0),
    )
    report.table(
        "Rare divergence",
        "One trial of a hundred errs twentyfold. The 95 % interval of the RMSE does not cover, and nothing that was "
        "seen can tell, where no such trial was: nothing is promised. Shown are the coverage, how often a sentence "
        "warns (such a trial is among 10, 30, 100 with probability 0.10, 0.26, 0.63), and the coverage where none "
        "does.",
        dict(zip(RARE, np.transpose([rare(n) for n in TRIALS]).tolist(), strict=True)),
        (0.0, 1.0),
    )
    report.table(
        "False differences and false ties",
        "Two equals, and families of equals. Promised: at most 0.05.",
        {
            "the test of the change": rates("difference of two", one_test),
            "p and interval disagree (RMSE differs by 20 %)": rates("disagreeing", disagreeing),
            f"a family of {FAMILY} against one baseline, Holm": rates("holm", families(statistics.holm)),
            "(the same family, unadjusted)": rates("bare", families(lambda p: p)),
            "a tie within 10 % where the truth is 10 %": rates("ties", ties),
        },
        repeats=REPEATS // 4,
    )
    report.table(
        "False separations",
        f"{BOARDS} boards of one study and ten methods whose mean squared errors are equal, lognormal: the share of "
        "boards on which two are said to differ. Promised: at most 0.05. Rows in brackets are the letters of a report, "
        f"whose limit is 0.05 where that of a board is {SEPARATED}.",
        {
            **{how: boards(spread, lambda mse: board_letters({"": mse})[""]) for how, spread in SKEWS.items()},
            **{f"({how})": boards(spread, letters) for how, spread in SKEWS.items()},
        },
        repeats=BOARDS,
    )
    report.table(
        "False verdicts",
        "What is claimed and what is true, at the edge where it is hardest; the rate of verdicts that are false. "
        "Promised: at most 0.05.",
        {name: rates(name, lie(*case)) for name, case in LIES.items()},
    )
    report.table(
        "Ledgers",
        f"Ledgers of {FAMILY} claims that one is better, of equals: the share with a false verdict, and the share of "
        "false verdicts beyond the number that was foreseen. Promised: at most 0.05.",
        {
            "any verdict that stands after Holm": rates("standing", ledgers(standing=True)),
            "(any verdict that is decided)": rates("decided", ledgers(standing=False)),
            "false verdicts that were not foreseen": rates("overlooked", overlooked),
        },
        repeats=REPEATS // 4,
    )
    report.table(
        "Flags of consistency",
        f"Trials of {TICKS} ticks, whose errors remember {MEMORY:g} of the last one. On a limit itself neither side is "
        "false; just within it, the flag would be. Promised: at most 0.05.",
        {
            "consistent (ANEES 1), flagged": flagged(1.0, ("over-confident", "conservative")),
            "ANEES 1.5, called over-confident": flagged(1.5, ("over-confident",)),
            "ANEES 0.67, called conservative": flagged(0.67, ("conservative",)),
            "ANEES 1.5, called consistent": flagged(1.5, ("consistent",)),
            "ANEES 0.67, called consistent": flagged(0.67, ("consistent",)),
            "ANEES 0.1, called over-wide": flagged(0.1, ("over-wide",)),
            "(ANEES 1, not shown to be consistent)": flagged(1.0, ("not shown",)),
        },
    )
    report.lines += ["", "## Promises", ""]
    kept = "None is missed by more than three standard errors."
    report.lines += [f"- missed: {line}" for line in report.broken] or [kept]
    text = "\n".join(report.lines) + "\n"
    page = Path(sys.argv[1])
    _, mark, rest = (page.read_text(encoding="utf-8") if page.exists() else "").partition("\n<!-- stopping -->")
    page.write_text(text + mark + rest, encoding="utf-8")  # stopping.py writes the rest
    print(text)
    print(f"{time.perf_counter() - began:.0f} s")
    return 1 if report.broken else 0


HEADER = f"""
# How often the statistics are right

    make prove

Worlds whose truth is known, {REPEATS} repetitions a rate (a quarter of them for families and ledgers),
at {", ".join(map(str, TRIALS))} trials. Mean squared errors of a trial are normal (standard deviation a seventh of the
mean), lognormal (skewed: 0.5 in the logarithm) or heavy-tailed (|t| of three degrees of freedom, without a third
moment); what is hard for one estimator in a trial is hard for all. A rate in **bold** misses the promise by more than
three standard errors. One that is not bold may still lie beyond it, by up to {slack(REPEATS):.3f} in the tables of
coverage, verdicts and flags, {slack(REPEATS // 4):.3f} in the others. The promises are made for normal and lognormal
errors; heavy tails show what happens beyond them.
"""

if __name__ == "__main__":
    sys.exit(main())
