"""What a report says of its methods, term by term."""

from cooploc.analysis.metrics.compare import FAR
from cooploc.analysis.report.result_tables import STOPPED

FLOORED = 20  # robots: the floor of larger teams takes seconds for each scenario
FLOOR_PATHS, FLOOR_TRIALS = 16, 8  # over which a floor is taken, in a fifth of the time that one to 0.2 % takes
METHODS = (
    ("Trial", "The unit of every interval and test; its robots and ticks are not independent, and pooled first."),
    ("RMSE",
     "Root of the mean over trials of the mean squared position error [m]; jackknife interval on its logarithm."),
    ("Change", "RMSE relative to the baseline's on the same streams, paired by trial; Fieller's 95 % interval."),
    ("p (Holm)",
     "The t test over trials that the interval of the change inverts, so that the two never disagree, adjusted by Holm "
     "over all rows of all experiments. It is 1 where the better one of the two failed in a trial."),
    ("Ties",
     "The 95 % interval of the paired change holds 0, or two one-sided tests of the same kind say that the RMSE "
     "are equal within 5 %. An estimator is best alone only where its interval against every other that qualifies "
     "excludes 0."),
    ("Rank, group",
     "Mean over trials of the rank by RMSE, including centralised and over-confident ones. Estimators that share a "
     "letter do not differ significantly at 5 %: the test of the change, of all pairs, adjusted by Holm, so that it "
     "separates fewer estimators than the ties above, which are not adjusted. An estimator that failed in a trial or a "
     "check has neither rank nor letter, and takes none from others. No letters: fewer than two estimators, or five "
     "trials."),
    ("Failed trials",
     "A trial failed that raised, took too long, or whose error is not finite. The numbers of an estimator that failed "
     "are of its other trials, so they are not of the same trials as those beside them: it is not ranked, is never "
     "best, no difference in its favour is significant, and no claim about it is supported."),
    ("Median, outlying",
     f"Of the trials' RMSE; outlying: share of trials above {FAR:g} times that median, with Wilson's "
     "interval. An interval of the RMSE cannot hold what no trial has shown: where one trial of a hundred diverges "
     "twentyfold, it misses the truth in most runs of 20 trials."),
    ("NLL, ellipse",
     "Mean negative log-likelihood of the true position [nats], a proper score: smaller is better, and neither too "
     "small nor too large a covariance improves it. Mean area of the 95 % ellipse [m²]."),
    ("ANEES",
     "Position NEES / 2, per trial first; 1 is consistent. Over-confident: its 95 % interval lies above 1.5, or that "
     "of the share in 95 % ellipses below 0.86; conservative: wholly below 0.67; over-wide: wholly below 0.1, ellipses "
     "ten times as large as the errors ask for; consistent: wholly within 0.67 to 1.5; not shown: it holds a limit. An "
     "estimator that is over-confident, over-wide, or not shown with an ANEES above 3, never qualifies as best. A mean "
     "over trials may be that of one collapsed trial: beside it stand the median over trials, and the share of trials "
     "whose ANEES exceeds 100 (collapsed; Wilson's interval)."),
    ("As published, at its best",
     "Of a method that was run in several configurations: the paper's own, and the one of smallest error with the same "
     "readings (`cooploc list estimators`). Estimators without this remark are other configurations, or their method "
     "has only one."),
    ("Floor",
     "The posterior Cramer-Rao bound on the RMSE of any estimator that hears and uses every reading (Tichavsky 1998), "
     f"where the assumed models are the true ones; for up to {FLOORED} robots, to about 2 %."),
    ("in 95 %", "Share of the true positions that lie inside the 95 % ellipse."),
    ("diverged", "Share of (trial, robot) whose last-quarter RMSE exceeds a quarter of the arena's side."),
    ("messages, bytes, µs",
     "Per robot and tick; messages and bytes as sent, µs of wall-clock time on the processor named below."),
    ("Checks",
     "An estimator that is not built in is checked before it runs: it must not see the truth, the future or lost "
     "packets, and must give the same bits however it is run. One that fails a check is marked and not ranked."),
    ("Centralised, bound", "Every reading reaches one computer, which knows more than any robot could; shown and not "
     "ranked. A bound uses all of them as well as any estimator could."),
    ("Below five trials", "No intervals, tests or verdicts are given."),
    ("Claims",
     "Each is judged by one number with its 95 % interval; a verdict needs the whole interval on its side. `cooploc "
     "verdicts` prints them."),
)  # fmt: skip
BY_SEQUENCES = {  # of a run until decided, in place of those above
    "p (Holm)":
    "1 / e of the confidence sequence of the change, which is valid however a run stops, adjusted by Holm over all "
    "rows of all experiments. It is 1 where the comparison rests on trials that failed.",
    "Ties":
    "The confidence sequence of the paired change holds 0, or lies within 5 %. An estimator is best alone only where "
    "its sequence against every other that qualifies excludes 0.",
    "Rank, group":
    "Estimators that share a letter are not told apart by the confidence sequence of their change: all pairs, each "
    "over the trials that both have, adjusted by Holm. There are no ranks: rows stop at different numbers of trials, "
    "and a mean of ranks over the few that all have would leave out the others. An estimator that failed in a trial "
    "or a check has no letter.",
}  # fmt: skip


def methods(until_decided: bool) -> tuple[tuple[str, str], ...]:
    """Terms and what they mean, in a run of a fixed number of trials or in one until decided."""
    if not until_decided:
        return METHODS
    return (*((term, BY_SEQUENCES.get(term, meaning)) for term, meaning in METHODS), ("Decided", STOPPED))
