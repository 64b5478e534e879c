"""The conformance checks bite: every broken estimator of the gallery is caught by the check that is meant for it."""

import dataclasses
import re
import time

import broken
import cloudpickle
import honest
import numpy as np
import pytest

from cooploc.analysis.execution import provenance
from cooploc.analysis.metrics.ranking import missing_checks
from cooploc.estimators import BUILTIN, make
from cooploc.estimators.adapters import PerRobot
from cooploc.estimators.dead_reckoning import DeadReckoning
from cooploc.estimators.errors import BadInput
from cooploc.scenarios.check_harness import CheckFailed, Harness, require_equal
from cooploc.scenarios.conformance import CHECKS, Report, Result, _check_here, check_estimator, declaration, run_check

NAMES = [
    "runs", "determinism", "truth-blindness", "causality", "link-honesty", "non-interference", "immutability",
    "nan-safety", "covariance", "silence", "declaration", "equivariance",
]  # fmt: skip

# estimator, the check that must catch it, what that check must say
GALLERY = [
    (broken.NotFinite(), "runs", "not finite in 'robots-1-3/n=3.*trial 0, tick 0, robot"),
    (broken.OldInterface(), "runs", "written for interface 0"),
    (broken.SendsNone(), "runs", r"send\(\) returned None at tick 0: did you forget its return\?"),
    (broken.UnknownChannel(), "runs", "needs channel 'telepathy'; scenario 'robots.*; scenario 'camera"),
    (broken.Crashes(), "runs", r"correct\(\) raised at tick 0 of 'robots.*TypeError: unsupported.* \(broken.py:\d+\)"),
    (broken.IgnoresAbsence(), "runs", "not finite in .*some readings absent', trial 0, tick 1, robot 0"),
    (broken.DeadReckoning, "runs", "is the class DeadReckoning, not an instance"),
    (None, "runs", "it is of type NoneType and has no method of an estimator"),
    (broken.ReturnsPositions(), "runs", r"estimate\(\) at tick 0 returned ndarray: return Belief\(x, P\)"),
    (broken.Undecorated(), "runs", "Undecorated declares parameters, which it does not get"),
    (broken.Misspells(), "runs", "needs channel 'anchor_rsi'.*; did you mean 'anchor_rssi'"),
    (broken.WritesReadings(), "runs", r"predict\(\) raised at tick 0.*read-only"),
    (broken.GlobalRng(), "determinism", "changed by up to .* it ran a second time"),
    (broken.ContinuesLastRun(), "determinism", "when it ran a second time"),
    (broken.NotPicklable(scale=(v for v in ())), "determinism", "cannot be pickled.*cannot pickle 'generator'"),
    (broken.ForgetsParameter(drift=0.1), "determinism", "when it ran after a round trip through pickle"),
    (broken.KnowsTheLabel(), "truth-blindness", "when the stream had another label"),
    (broken.Prophet(), "causality", "readings after tick 3 were perturbed"),
    (broken.KnowsLength(), "causality", "the stream ended after tick 3"),
    (broken.ForeseesAbsence(), "causality", "readings after tick 3 were hidden"),
    (broken.UsesDroppedPackets(), "link-honesty", "from tick 4 on while all its packets were dropped"),
    (broken.SendsLittleReadsMore(), "non-interference", "robot 1's estimate changed .*the mail stayed"),
    (broken.ReadsNeighbour(), "non-interference", "robot 1's estimate changed by up to .* when robot 0's readings"),
    (broken.WaitsForAll(), "non-interference", "robot 0's readings were hidden"),
    (broken.SendsOthers(), "non-interference", "robot 1's packet changed .* when robot 0's"),
    (broken.DrawsByPosition(), "non-interference", r"trials \[1\] ran instead of all 3"),
    (broken.MultipliesRows(), "non-interference", "ran instead of all 3"),
    (broken.InPlace(), "immutability", r"state was changed by correct\(\) at tick 0"),
    (broken.CountsCalls(), "immutability", "its parameters were changed by running"),
    (broken.TrustsOdometry(), "nan-safety", r"not finite .*\(single readings of odometry were absent\)"),
    (broken.Asymmetric(), "covariance", "covariance is not symmetric in .*robot 0"),
    (broken.NegativeVariance(), "covariance", "covariance has a negative variance in .*robot 0"),
    (broken.IgnoresOdometry(), "silence", "away from where odometry leads, by .* m that are allowed, when nothing"),
    (PerRobot(broken.StaysAtRandom), "silence", "away from where odometry leads"),
    (broken.ShrinksCovariance(), "silence", "robot 0's position variance shrank when nothing"),
    (broken.DeclaresTooMuch(), "declaration", "declares anchor_rssi, landmark, but that never changed"),
    (broken.MessagesWithoutBytes(), "declaration", "states messages and bytes of which each has no header"),
    (broken.PrefersNorth(), "equivariance", "when the world was turned by 90 degrees and shifted"),
]


def test_an_error_that_is_often_made_has_a_remedy_of_its_own():
    result = run_check("runs", Harness("mine", broken.LooksForRanges(), seed=0))
    assert "'Mail' object has no attribute 'radio_range'" in result.detail
    assert result.remedy.endswith("mail.range, mail.rssi")


def named(value):
    return type(value).__name__ if dataclasses.is_dataclass(value) else str(value)[:20]


def assert_ran(report, checks):
    """Exactly these checks ran, and each that passed ran the estimator at least twice, unless it declares nothing."""
    assert [r.check for r in report.results] == NAMES == list(CHECKS)
    assert {r.check for r in report.results if r.status != "skipped"} == set(checks)
    passed = [r.detail for r in report.results if r.status == "passed" and "declared channel ()" not in r.detail]
    assert not [detail for detail in passed if re.search(r"\([01] runs\)$", detail)]


@pytest.mark.parametrize(("estimator", "check", "words"), GALLERY, ids=named)
def test_each_check_catches_what_it_is_for(estimator, check, words):
    result = run_check(check, Harness(named(estimator), estimator, seed=0))
    assert result.status == "failed", result
    assert re.search(words, result.detail), result.detail
    assert "\n" not in result.detail
    assert result.remedy


@pytest.mark.slow
def test_what_does_not_run_or_does_not_repeat_itself_is_not_checked_further():
    report = check_estimator(broken.NotFinite())
    assert_ran(report, ["runs"])
    assert {r.detail for r in report.results[1:]} == {"it does not run"}
    report = check_estimator(broken.GlobalRng(), isolate=False)
    assert [r.check for r in report.results if r.status == "failed"] == ["determinism"]
    assert report.ran == 2


@pytest.mark.slow
@pytest.mark.parametrize("cls", honest.HONEST)
def test_an_honest_estimator_with_unusual_habits_is_not_accused(cls):
    report = check_estimator(cls(), seed=0)
    assert report.passed, report.table()


@pytest.mark.slow
def test_a_class_of_a_notebook_with_a_state_of_its_own_is_not_accused():
    cloudpickle.register_pickle_by_value(honest)  # classes travel with their code, as those of a notebook do
    try:
        report = check_estimator(honest.SendsEveryThirdTick(), seed=0)
    finally:
        cloudpickle.unregister_pickle_by_value(honest)
    assert report.passed, report.table()


# particles do not turn with the world
RANDOM = {"arl", "rssi-pf", "mrsl-rssi", "mrsl-distance", "ctrn", "cmrl", "reciprocal-pf", "channel-pf"}


@pytest.mark.parametrize("name", BUILTIN)
@pytest.mark.slow
def test_built_in_estimators_pass(name, request):
    if name in ("map-joint", "gbp", "reciprocal-pf", "ukf-joint", "channel-pf", "cmrl"):  # which take long
        request.getfixturevalue("short_streams")
    report = check_estimator(make(name), name)
    assert report.passed, report.table()
    if name == "ekf-joint":
        assert "of other robots it knows all, as it is centralised" in report["non-interference"].detail
    exempt = ["equivariance"] * (name in RANDOM) + ["silence", "nan-safety"] * (name == "constant")
    exempt += ["link-honesty"] * (name in ("ekf-joint", "iekf-joint", "ukf-joint", "map-joint"))
    assert_ran(report, [check for check in NAMES if check not in exempt])


@pytest.mark.slow
@pytest.mark.parametrize("cls", [broken.Averages, broken.Addressed, broken.HonestTeam])
def test_correct_estimators_pass(cls):
    report = check_estimator(cls(), isolate=False)
    assert report.passed, report.table()
    assert_ran(report, NAMES)


def test_a_seed_that_cannot_be_is_bad_input():
    with pytest.raises(BadInput, match="seed is -1"):
        check_estimator(make("dead-reckoning"), seed=-1)


FOUND = [("one", "passed", "x < y"), ("two", "failed", "a & b"), ("c", "skipped", "no")]
REPORT = Report("<b>", tuple(Result(check, status, detail, seed=3) for check, status, detail in FOUND))


def test_a_report_counts_and_prints_what_ran_and_is_escaped_in_a_notebook():
    assert (REPORT.ran, REPORT.passed) == (2, False)
    assert REPORT.table().splitlines() == [
        "one  passed   x < y",
        "two  failed   a & b (seed 3)",
        "c    skipped  no",
        "<b>: 1 of 3 checks passed, 1 failed, 1 skipped",
    ]
    assert ">a &amp; b (seed 3)</td>" in REPORT._repr_html_()
    assert not Report("nothing", ()).passed
    assert not Report("all skipped", REPORT.results[2:]).passed


@pytest.mark.slow
def test_a_range_that_pays_only_where_robots_are_unequally_certain_counts_as_used():
    """Covariance intersection of two equally vague robots keeps what each had."""
    assert "radio_range" in declaration(Harness("ekf-ci", make("ekf-ci", anchor_reading="none"), 0))


class Circling(broken.IgnoresOdometry):
    own_motion = "it circles"


class DoesNotReadIt(broken.IgnoresOdometry):
    uses = ("anchor_rssi",)


@pytest.mark.parametrize(
    ("estimator", "status", "said"),
    [
        (broken.IgnoresOdometry(), "failed", "that are allowed, when nothing was sensed"),
        (Circling(), "skipped", "own_motion: it circles"),
        (DoesNotReadIt(), "skipped", "it declares no odometry"),
    ],
)
def test_silence_is_asked_of_what_moves_by_odometry(estimator, status, said):
    result = run_check("silence", Harness("it", estimator, seed=0))
    assert result.status == status
    assert said in result.detail


def test_the_sign_of_a_zero_is_a_difference():
    harness = Harness("any", make("dead-reckoning"), seed=0)
    a = harness.cases[1][1]
    P = a.trace.P.copy()
    P[0, 1, 0, 0, 1] *= -1
    b = a._replace(trace=dataclasses.replace(a.trace, P=P))
    require_equal(a, a, "nothing happened")
    with pytest.raises(CheckFailed, match=r"robot 0's estimate changed by up to 0, which is rounding, .*tick 1"):
        require_equal(a, b, "this")


@pytest.mark.slow
def test_an_estimator_that_hangs_is_ended_after_one_run_and_not_after_all_checks(tmp_path):
    method = "def correct(self, s, z):\n        while True: pass"
    text = f"from cooploc.estimators.dead_reckoning import DeadReckoning\nclass Hangs(DeadReckoning):\n    {method}\n"
    (tmp_path / "hangs.py").write_text(text)
    report = check_estimator(f"{tmp_path}/hangs.py:Hangs", time_limit=20.0)
    assert report["runs"].detail == "longer than the time limit of 2 s a trial: its process was ended"
    assert report.ran == 1


def test_checks_of_a_slow_estimator_for_which_no_time_is_left_are_skipped_and_counted_once(monkeypatch):
    clock = iter(range(10**6))
    monkeypatch.setattr(time, "monotonic", lambda: 10.0 * next(clock))  # every look at the clock, ten seconds
    report = _check_here(make("dead-reckoning"), "slow", 0, 600.0)
    done = sum(result.status == "passed" for result in report.results)
    assert 1 < done == report.ran < len(CHECKS)
    monkeypatch.setattr(provenance, "check_estimator", lambda label, **how: report)
    found = provenance.certify("slow")["found"]
    said = r"after \d+ runs the 600 s of all checks were over [(]cooploc check --time-limit gives more[)]"
    assert re.fullmatch(rf"{done} of 12 checks; {12 - done} skipped: {said}", found)
    assert missing_checks(f"passed: {found}") == "was not checked in full, as time was over"


class SeesHeadings(DeadReckoning):
    """Is less certain for each teammate whose heading it sees: a channel that only some worlds have."""

    uses = ("odometry", "orientation")

    def correct(self, s, z):
        seen = np.isfinite(z.extra["orientation"]).sum((1, 2))
        return s._replace(P=s.P + 1e-3 * seen[:, None, None] * np.eye(s.P.shape[-1]))


class SeesHeadingsOfAll(SeesHeadings):
    def correct(self, s, z):
        seen = np.full(len(s.x), np.isfinite(z.extra["orientation"]).sum())
        return s._replace(P=s.P + 1e-3 * seen[:, None, None] * np.eye(s.P.shape[-1]))


class NeedsFour(DeadReckoning):
    def init(self, prior, world, rows):
        if world.robots < 4:
            raise BadInput("it needs four robots")
        return super().init(prior, world, rows)


@pytest.mark.slow
def test_an_estimator_that_refuses_our_worlds_is_checked_in_one_that_it_is_made_for():
    refused = check_estimator(NeedsFour(), isolate=False)["runs"]
    assert "it needs four robots" in refused.detail
    assert refused.remedy.startswith("check it in a world that it is made for: cooploc check --scenario LABEL")
    assert check_estimator(NeedsFour(), isolate=False, scenarios=["nlos/n=2", "scalability/n=4"]).passed


class SeesHeadingsOfAllIfAny(SeesHeadingsOfAll):
    uses = ("odometry", "orientation?")

    def correct(self, s, z):
        return super().correct(s, z) if "orientation" in z.extra else s


OF_ALL = {"link-honesty", "non-interference"}  # what it breaks that takes other robots' readings without mail


@pytest.mark.slow
@pytest.mark.parametrize(("estimator", "failed"), [(SeesHeadings(), set()), (SeesHeadingsOfAll(), OF_ALL)])
def test_an_estimator_of_a_channel_that_our_worlds_lack_is_checked_where_there_is_one(estimator, failed):
    refused = check_estimator(estimator, isolate=False)["runs"]
    assert "needs channel 'orientation'" in refused.detail
    assert "cooploc check --scenario" in refused.remedy
    report = check_estimator(estimator, isolate=False, scenarios="camera/n={2,3,4}[sigma_orientation=0.1,view=3]")
    assert "of 12 ticks of camera/n=2, camera/n=3: every" in report["runs"].detail  # two worlds are enough
    assert failed == {r.check for r in report.results if r.status == "failed"}


@pytest.mark.slow
def test_a_channel_that_an_estimator_can_do_without_is_checked_where_there_is_one():
    assert check_estimator(SeesHeadingsOfAllIfAny(), isolate=False).passed
    report = check_estimator(
        SeesHeadingsOfAllIfAny(), isolate=False, scenarios="camera/n=2[sigma_orientation=0.1,view=3]"
    )
    assert "robots-1-3/n=3, robots-1-3/n=1, camera/n=3, camera/n=1, camera/n=2: every" in report["runs"].detail
    assert {r.check for r in report.results if r.status == "failed"} == OF_ALL
    assert report["equivariance"].status == "passed"  # in those worlds of which it is known how they turn


def test_checks_need_some_time():
    with pytest.raises(BadInput, match="time_limit is 0; it must be above 0 s"):
        check_estimator("dead-reckoning", time_limit=0)


class ForDisplacements(broken.DeadReckoning):
    def init(self, prior, world, rows):
        if world.landmarks.size:
            raise BadInput("it needs displacements as odometry")
        return super().init(prior, world, rows)


@pytest.mark.slow
def test_an_estimator_is_checked_in_the_worlds_that_it_does_not_refuse():
    report = check_estimator(ForDisplacements(), isolate=False)
    assert report.passed, report.table()
    assert "robots-1-3/n=3" in report["runs"].detail
    assert "camera" not in report["runs"].detail
