"""The conformance checks bite: every broken estimator of the gallery is caught by the check that is meant for it."""

import dataclasses
import pickle
import re

import broken
import honest
import numpy as np
import pytest

from cooploc.estimators import BUILTIN, make
from cooploc.estimators.adapters import PerRobot
from cooploc.estimators.errors import BadInput
from cooploc.estimators.interface import Belief
from cooploc.scenarios import simulate
from cooploc.scenarios.conformance.check import CHECKS, Check, Report, Result, check_estimator, run_check
from cooploc.scenarios.conformance.checks import declaration
from cooploc.scenarios.conformance.harness import Harness, snapshot
from cooploc.scenarios.runner.trace import trace

NAMES = [
    "runs", "determinism", "truth-blindness", "causality", "link-honesty", "non-interference", "immutability",
    "nan-safety", "covariance", "silence", "declaration", "equivariance",
]  # fmt: skip

# estimator, the check that must catch it, what that check must say
GALLERY = [
    (broken.NotFinite(), "runs", "not finite in 'robots-1-3/n=3.*trial 0, tick 0, robot"),
    (broken.WrongShape(), "runs", r"P of shape \(9, 2\)"),
    (broken.NoFuse(), "runs", r"no method fuse\(\)"),
    (broken.OldInterface(), "runs", "written for interface 0"),
    (broken.OneName(), "runs", "uses is 'odometry', not a tuple of channel names"),
    (broken.UnknownChannel(), "runs", "needs channel 'telepathy'; scenario 'robots.*; scenario 'camera"),
    (broken.BoundNotStated(), "runs", "does not say whether it is a bound"),
    (broken.Crashes(), "runs", r"correct\(\) raised at tick 0 of 'robots.*TypeError: unsupported operand"),
    (broken.IgnoresAbsence(), "runs", "not finite in .*some readings absent', trial 0, tick 1, robot 0"),
    (broken.DeadReckoning, "runs", "is the class DeadReckoning, not an instance"),
    (None, "runs", "interface None"),
    (broken.WritesReadings(), "runs", r"predict\(\) raised at tick 0.*read-only"),
    (
        broken.GlobalRng(),
        "determinism",
        "it draws from numpy.random, and does not repeat.*changed by up to .* it ran",
    ),
    (
        broken.ContinuesLastRun(),
        "determinism",
        "it draws from neither random nor numpy.random, and",
    ),
    (
        broken.ReadsNeighbour(),
        "non-interference",
        "robot 1's estimate changed by up to .* when robot 0's readings",
    ),
    (broken.WaitsForAll(), "non-interference", "robot 0's readings were hidden"),
    (broken.SharesClock(), "non-interference", "robot 0's readings were perturbed"),
    (broken.SendsOthers(), "non-interference", "robot 1's packet changed .* when robot 0's"),
    (broken.NotCentralised(), "non-interference", "robot 1's estimate changed .* when robot 0's"),
    (broken.UsesDroppedPackets(), "link-honesty", "from tick 4 on while all its packets were dropped"),
    (broken.UsesDroppedRadio(), "link-honesty", "radio readings of dropped packets were perturbed"),
    (
        broken.SendsLittleReadsMore(),
        "link-honesty",
        "robot 1's estimate changed .* when robot 0's.*the mail stayed",
    ),
    (broken.Prophet(), "causality", "readings and links after tick 3 were perturbed"),
    (broken.KnowsLength(), "causality", "the stream ended after tick 3"),
    (broken.ProphetAlone(), "causality", "readings and links after tick 6 were perturbed.*tick 0"),
    (broken.ForeseesAbsence(), "causality", "readings and links after tick 3 were hidden"),
    (broken.ForeseesLinks(), "causality", "readings and links after tick 3 were perturbed"),
    (broken.Centred(), "non-interference", "robot 1's estimate changed"),
    (broken.DrawsByPosition(), "non-interference", r"trials \[1\] ran instead of all 3"),
    (broken.MultipliesRows(), "non-interference", "ran instead of all 3"),
    (broken.SendsByChunk(), "non-interference", "robot 0's packet changed"),
    (broken.TrafficByChunk(), "non-interference", r"sent other messages when trials \[0\] ran instead"),
    (broken.ForcesReadings(), "immutability", r"senses.odometry was changed by predict\(\) at tick 0"),
    (broken.WritesWorld(), "immutability", r"state.world.arena was changed by correct\(\) at tick 0"),
    (broken.WritesStream(), "immutability", r"the stream\['senses.dt'\] was changed during the run of 'robots"),
    (broken.InPlace(), "immutability", r"state.x was changed by correct\(\) at tick 0"),
    (broken.InPlaceEstimate(), "immutability", r"state.P was changed by estimate\(\) at tick 0"),
    (broken.CountsCalls(), "immutability", r"its parameters.calls\[\d+\] was changed by running"),
    (broken.ContinuesLastRun(), "immutability", "when it ran a second time"),
    (broken.GlobalRng(), "immutability", "when it ran a second time"),
    (broken.DependsOnOtherRuns(), "determinism", "when another run came before"),
    (broken.SeedsGlobal(), "determinism", "drew from or seeded numpy.random, on 'robots"),
    (broken.PythonRandom(), "determinism", "it draws from neither random nor numpy.random, and"),
    (broken.FindsTruth(), "truth-blindness", "when its truth was in memory"),
    (broken.KnowsTheLabel(), "truth-blindness", "when the stream had another label"),
    (broken.TrustsOdometry(), "nan-safety", r"not finite .*\(single readings of odometry were absent\)"),
    (broken.Asymmetric(), "covariance", "robot 0's covariance is not symmetric"),
    (broken.NegativeVariance(), "covariance", "robot 0's covariance has a negative variance"),
    (
        broken.IgnoresOdometry(),
        "silence",
        "m away from where odometry leads, where .* m is allowed, when nothing",
    ),
    (
        broken.ShrinksCovariance(),
        "silence",
        "robot 0's position variance shrank when nothing",
    ),
    (broken.DeclaresTooMuch(), "declaration", "declares anchor_rssi, landmark, but that never changed"),
    (broken.MessagesWithoutBytes(), "declaration", "states messages and bytes of which each has no header"),
    (broken.PrefersOrigin(), "equivariance", "when the world was shifted"),
    (broken.PrefersNorth(), "equivariance", "when the world was turned by 90 degrees"),
    (
        broken.PrefersRobotZero(),
        "equivariance",
        "covariance did not follow when its robots were renumbered",
    ),
    (broken.NotPicklable(scale=(v for v in ())), "determinism", "cannot be pickled.*cannot pickle 'generator'"),
    (broken.ForgetsParameter(drift=0.1), "determinism", "when it ran after a round trip through pickle"),
]


def named(value):
    return type(value).__name__ if dataclasses.is_dataclass(value) else str(value)[:20]


def assert_ran(report, checks):
    """Exactly these checks ran, and each ran the estimator at least twice."""
    assert [r.check for r in report.results] == NAMES
    assert {r.check for r in report.results if r.status != "skipped"} == set(checks)
    assert report.ran == len(checks)
    for r in report.results:
        if r.status == "passed":
            assert int(re.search(r"\((\d+) runs\)$", r.detail)[1]) >= 2


@pytest.mark.parametrize(("estimator", "check", "words"), GALLERY, ids=named)
def test_each_check_catches_what_it_is_for(estimator, check, words):
    result = run_check(next(c for c in CHECKS if c.name == check), Harness(named(estimator), estimator, seed=0))
    assert result.status == "failed", result
    assert re.search(words, result.detail), result.detail
    assert "\n" not in result.detail
    assert result.remedy


@pytest.mark.parametrize("estimator", [broken.NotFinite(), broken.NotFinite, None], ids=["instance", "class", "None"])
def test_what_does_not_run_is_not_checked_further(estimator):
    report = check_estimator(estimator)
    assert not report.passed
    assert_ran(report, ["runs"])
    assert {r.detail for r in report.results[1:]} == {"it does not run"}


def test_what_does_not_repeat_itself_is_accused_of_that_alone():
    report = check_estimator(broken.GlobalRng())
    assert [r.check for r in report.results if r.status == "failed"] == ["determinism"]
    assert {r.detail for r in report.results[2:]} == {
        "it does not repeat itself, so no two of its runs can be compared"
    }


def test_a_crash_of_a_check_is_not_the_estimators_fault():
    def crashes(harness):
        raise ZeroDivisionError("a mistake of ours")

    harness = Harness("dead-reckoning", make("dead-reckoning"), seed=0)
    found = run_check(Check("crashes", crashes, "nothing"), harness)
    assert found.status == "skipped"
    assert found.detail.startswith(
        "the check itself crashed, which says nothing about the estimator: ZeroDivisionError"
    )
    blamed = run_check(CHECKS[0], Harness("moody", broken.MoodyProperty(), seed=0))
    assert blamed.status == "failed"
    assert "ZeroDivisionError" in blamed.detail


@pytest.mark.slow
@pytest.mark.parametrize("cls", honest.HONEST)
def test_an_honest_estimator_with_unusual_habits_is_not_accused(cls):
    report = check_estimator(cls(), seed=0)
    assert report.passed, report.table()


def test_the_gallery_has_something_for_every_check():
    assert {check for _, check, _ in GALLERY} == set(NAMES)
    assert [c.name for c in CHECKS] == NAMES


# particles do not turn with the world
RANDOM = {"arl", "rssi-pf", "mrsl-rssi", "mrsl-distance", "ctrn", "cmrl", "reciprocal-pf", "channel-pf"}


@pytest.mark.parametrize("seed", [0, 1])
@pytest.mark.parametrize("name", BUILTIN)
@pytest.mark.slow
def test_built_in_estimators_pass(name, seed):
    estimator = make(name)
    report = check_estimator(estimator, name, seed)
    assert report.passed, report.table()
    exempt = ["equivariance"] * (name in RANDOM) + ["silence", "nan-safety"] * (name == "constant")
    assert_ran(report, [check for check in NAMES if check not in exempt])
    assert {r.seed for r in report.results} == {seed}


@pytest.mark.parametrize("cls", [broken.Broadcasts, broken.Averages, broken.Addressed, broken.HonestTeam])
@pytest.mark.parametrize("seed", [0, 1])
def test_correct_estimators_pass(cls, seed):
    report = check_estimator(cls(), seed=seed)
    assert report.passed, report.table()
    assert_ran(report, NAMES)


@pytest.mark.parametrize("cls", [broken.BaseReader, broken.TeamBaseReader])
@pytest.mark.slow
def test_following_an_array_to_its_base_finds_nothing_or_is_caught(cls):
    report = check_estimator(cls())
    correct = cls.__mro__[1]()
    for label in ("robots-1-3/n=3", "camera"):
        _, stream = simulate(label, trials=1, ticks=6)
        found = not np.array_equal(trace("base", cls(), stream).x, trace("correct", correct, stream).x)
        assert not found or report["causality"].status == "failed"


@pytest.mark.slow
def test_a_centralised_estimator_is_exempt_from_what_it_cannot_keep_and_the_report_says_so():
    report = check_estimator(make("ekf-joint"))
    assert report["non-interference"].detail.endswith("of other robots it knows all, as it is centralised (16 runs)")
    assert (
        "radio readings of dropped packets were perturbed and hidden: nothing changed" in report["link-honesty"].detail
    )
    seeing = check_estimator(SeeingCentralised())
    assert (seeing["link-honesty"].status, seeing.ran) == ("skipped", len(CHECKS) - 1)


@dataclasses.dataclass(frozen=True)
class SeeingCentralised(broken.EkfJoint):
    @property
    def uses(self):
        return ("odometry", "landmark", "sighting")


@pytest.mark.slow
def test_the_report_is_the_same_every_time():
    for estimator in (make("mrsl-rssi"), broken.ReadsNeighbour()):
        assert check_estimator(estimator) == check_estimator(estimator)


def test_checks_leave_global_randomness_alone():
    before = snapshot(np.random.get_state(), "numpy")  # noqa: NPY002
    check_estimator(make("mrsl-rssi"))
    assert snapshot(np.random.get_state(), "numpy") == before  # noqa: NPY002


def test_unknown_failures_of_an_estimator_are_failures_of_the_check():
    class Odd(broken.DeadReckoning):
        @property
        def uses(self):
            raise RuntimeError("not\ntoday")

    assert check_estimator(Odd.__new__(Odd))["runs"].detail == "RuntimeError: not today"


def test_a_seed_that_cannot_be_is_bad_input():
    with pytest.raises(BadInput, match="seed is -1"):
        check_estimator(make("dead-reckoning"), seed=-1)


# ---------------------------------------------------------------- the report


FOUND = [("one", "passed", "x < y"), ("two", "failed", "a & b"), ("c", "skipped", "no")]
REPORT = Report("<b>", tuple(Result(check, status, detail, seed=3) for check, status, detail in FOUND))


def test_a_report_counts_and_prints_what_ran():
    assert (REPORT.ran, REPORT.passed) == (2, False)
    assert repr(REPORT) == "Report('<b>: 2 checks ran; 1 passed, 1 failed, 1 skipped')"
    assert REPORT.table().splitlines() == [
        "one  passed   x < y",
        "two  failed   a & b (seed 3)",
        "c    skipped  no",
        "<b>: 2 checks ran; 1 passed, 1 failed, 1 skipped",
    ]
    assert REPORT["two"].detail == "a & b"
    with pytest.raises(KeyError):
        REPORT["three"]


def test_a_report_in_a_notebook_is_escaped():
    html = REPORT._repr_html_()
    assert "&lt;b&gt;: 2 checks ran" in html
    assert "<td>x &lt; y</td>" in html
    assert "<td>a &amp; b (seed 3)</td>" in html


def test_nothing_checked_is_not_passed():
    assert not Report("nothing", ()).passed
    assert not Report("all skipped", (Result("one", "skipped", "", 0),)).passed


# ---------------------------------------------------------------- loading


PLUGIN = """
from dataclasses import dataclass
from cooploc.estimators.ekf_local import EkfLocal

@dataclass(frozen=True)
class Mine(EkfLocal):
    scale: float = 1.0

@dataclass(frozen=True)
class Needs:
    size: int

mine = Mine(gate=5.0)
"""


@pytest.fixture
def plugin(tmp_path):
    path = tmp_path / "plugin.py"
    path.write_text(PLUGIN)
    return path


def test_a_configured_name_is_loaded():
    assert make("mrsl-rssi[particles=50]") == make("mrsl-rssi", particles=50)


def test_a_file_gives_a_class_or_an_instance_and_both_can_be_checked(plugin):
    made, instance = make(f"{plugin}:Mine"), make(f"{plugin}:mine")
    assert (made.scale, instance.gate) == (1.0, 5.0)
    assert pickle.loads(pickle.dumps(made)) == made
    report = check_estimator(made)
    assert report.passed, report.table()
    assert_ran(report, NAMES)


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("Mime", "plugin.py has no 'Mime'; did you mean 'Mine'"),
        ("Needs", "cannot be made without arguments .*size.*; give its parameters defaults, or name an instance"),
        ("", "has no ''; known are"),
    ],
)
def test_what_a_file_lacks_is_named(plugin, name, words):
    with pytest.raises(BadInput, match=words) as caught:
        make(f"{plugin}:{name}")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("source", "words"),
    [
        (
            "import nothing_of_that_name",
            "cannot be imported: ModuleNotFoundError: No module",
        ),
        ("def broken(:", "cannot be imported: SyntaxError"),
        ("raise SystemExit(3)", "cannot be imported: SystemExit: 3"),
    ],
)
def test_a_file_that_cannot_be_imported_says_why(tmp_path, source, words):
    path = tmp_path / "bad.py"
    path.write_text(source)
    with pytest.raises(BadInput, match=words):
        make(f"{path}:Mine")


@pytest.mark.parametrize(
    ("spec", "words"),
    [
        ("nowhere.py:Mine", "no file nowhere.py; write path.py:Name"),
        ("nowhere.py", "nowhere.py is a file: say which of its names, nowhere.py:Name"),
        ("mrsl-rsi", "no estimator 'mrsl-rsi'; did you mean 'mrsl-rssi'"),
        ("mrsl-rssi[particle=5]", "no parameter 'particle'; did you mean 'particles'"),
    ],
)
def test_what_cannot_be_loaded_is_bad_input(spec, words):
    with pytest.raises(BadInput, match=words):
        make(spec)


@pytest.mark.slow
def test_what_is_seldom_used_is_not_called_unused():
    found = check_estimator(make("ekf-ci"), "ekf-ci", seed=10)  # in whose small streams no fusion by range pays
    assert found.passed, found


@pytest.mark.parametrize("name", ["ekf-ci", "ctrn[weights=exact]"])
def test_a_range_that_pays_only_where_robots_are_unequally_certain_counts_as_used(name):
    """Covariance intersection of two equally vague robots keeps what each had."""
    harness = Harness(name, make(name, anchor_reading="none"), 0)
    assert "radio_range" in declaration(harness)


class Circling:
    """A plain filter that turns on its own."""

    uses = ("odometry", "anchor_rssi|landmark")

    def __init__(self, prior, world, robot, key):
        self.x, self.P = prior.x, prior.P

    def predict(self, z):
        self.x[0] += 0.3
        self.P = 1.1 * self.P

    def correct(self, z): ...

    def estimate(self):
        return Belief(self.x.copy(), self.P)


@pytest.mark.parametrize(
    ("more", "status", "said"),
    [
        ({}, "failed", "m is allowed, when nothing was sensed"),
        ({"own_motion": "it circles"}, "skipped", "own_motion: it circles"),
        ({"uses": ("anchor_rssi",)}, "skipped", "it declares no odometry"),
    ],
)
def test_silence_is_asked_of_what_moves_by_odometry(more, status, said):
    report = check_estimator(PerRobot(Circling, **more), isolate=False, only="silence")
    assert [r.check for r in report.results] == ["silence"]
    assert report["silence"].status == status
    assert said in report["silence"].detail


def test_a_check_that_there_is_not_is_refused_with_the_nearest_name():
    with pytest.raises(BadInput, match="there is no check 'causalty'; did you mean 'causality'"):
        check_estimator("ekf-local", only="causalty")
