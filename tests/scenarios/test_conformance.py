"""The conformance checks bite: every broken estimator of the gallery is caught by the check that is meant for it."""

import dataclasses
import pickle
import re

import broken
import numpy as np
import pytest
from oracles import linear_team

from cooploc.estimators import BUILTIN, make
from cooploc.estimators.plugins.errors import BadInput
from cooploc.scenarios import simulate
from cooploc.scenarios.conformance import perturb
from cooploc.scenarios.conformance.check import CHECKS, Report, Result, check_estimator
from cooploc.scenarios.conformance.harness import Bench, Failed, demand_same
from cooploc.scenarios.conformance.snapshot import contents
from cooploc.scenarios.runner.trace import trace

NAMES = [
    "runs",
    "non-interference",
    "link-honesty",
    "causality",
    "chunk-invariance",
    "immutability",
    "no-memory",
    "no-global-randomness",
    "order-independence",
    "truth-blindness",
    "nan-safety",
    "covariance",
    "silence",
    "declaration",
    "equivariance",
    "pickling",
]

# estimator, the check that must catch it, what that check must say
GALLERY = [
    (broken.NotFinite(), "runs", "not finite in 'robots-1-3/n=3.*trial 0, tick 0, robot"),
    (broken.WrongShape(), "runs", r"P of shape \(9, 2\)"),
    (broken.NoFuse(), "runs", r"no method fuse\(\)"),
    (broken.OldInterface(), "runs", "interface 0; set api = 1"),
    (broken.OneName(), "runs", "must be a tuple of channel names"),
    (broken.Telepath(), "runs", "needs channel 'telepathy'; scenario 'robots.*; scenario 'camera"),
    (broken.Undecided(), "runs", "set bound = True or False"),
    (broken.Crashes(), "runs", r"correct\(\) raised at tick 0 of 'robots.*TypeError: unsupported operand"),
    (broken.Deaf(), "runs", "not finite in .*some readings absent', trial 0, tick 1, robot 0"),
    (broken.DeadReckoning, "runs", "is the class DeadReckoning, not an instance"),
    (None, "runs", "interface None"),
    (broken.WritesReadings(), "runs", r"predict\(\) raised at tick 0.*read-only; an input is never written to"),
    (broken.ReadsNeighbour(), "non-interference", "robot 1's estimate changed when robot 0's readings were shaken"),
    (broken.WaitsForAll(), "non-interference", "robot 0's readings were hidden"),
    (broken.OneClock(), "non-interference", "robot 0's readings were shaken"),
    (broken.Gossip(), "non-interference", "robot 1's packet changed when robot 0's"),
    (broken.SharedTeam(), "non-interference", "robot 1's estimate changed when robot 0's"),
    (broken.HearsDropped(), "link-honesty", "from tick 4 on while all its packets were dropped"),
    (broken.MeasuresDropped(), "link-honesty", "radio readings of packets that were dropped were shaken"),
    (broken.Prophet(), "causality", "readings and links after tick 3 were shaken"),
    (broken.Counts(), "causality", "the stream ended after tick 3"),
    (broken.LonelyProphet(), "causality", "readings and links after tick 6 were shaken.*tick 0"),
    (broken.ForeseesAbsence(), "causality", "readings and links after tick 3 were hidden"),
    (broken.ForeseesLinks(), "causality", "readings and links after tick 3 were shaken"),
    (broken.Centred(), "chunk-invariance", r"trials \[0\] ran instead of all 3"),
    (broken.DrawsByPosition(), "chunk-invariance", r"trials \[1\] ran instead of all 3"),
    (broken.MultipliesRows(), "chunk-invariance", "ran instead of all 3"),
    (broken.SendsByChunk(), "chunk-invariance", "robot 0's packet changed"),
    (broken.BillsByChunk(), "chunk-invariance", r"sent other messages when trials \[0\] ran instead"),
    (broken.ForcesReadings(), "immutability", r"senses.odometry was changed by predict\(\) at tick 0"),
    (broken.WritesWorld(), "immutability", r"state.world.arena was changed by correct\(\) at tick 0"),
    (broken.WritesStream(), "immutability", r"the stream\['senses.dt'\] was changed during the run of 'robots"),
    (broken.InPlace(), "immutability", r"state.x was changed by correct\(\) at tick 0"),
    (broken.InPlaceEstimate(), "immutability", r"state.P was changed by estimate\(\) at tick 0"),
    (broken.CountsCalls(), "immutability", r"its parameters.calls\[\d+\] was changed by running"),
    (broken.Remembers(), "immutability", "when it ran a second time"),
    (broken.GlobalRng(), "immutability", "when it ran a second time"),
    (broken.WarmStart(), "no-memory", "when another run came before"),
    (broken.GlobalRng(), "no-global-randomness", "drew from or seeded numpy.random, on 'robots"),
    (broken.SeedsGlobal(), "no-global-randomness", "drew from or seeded numpy.random, on 'robots"),
    (broken.PythonRandom(), "no-global-randomness", "when the global generators were seeded with"),
    (broken.CountsRivals(), "order-independence", "when it ran among it, dead-reckoning"),
    (broken.FindsTruth(), "truth-blindness", "when its truth was in memory"),
    (broken.KnowsTheLabel(), "truth-blindness", "when the stream bore another label"),
    (broken.TrustsOdometry(), "nan-safety", r"not finite .*\(single numbers of odometry were absent\)"),
    (broken.Lopsided(), "covariance", "robot 0's covariance is not symmetric"),
    (broken.NegativeVariance(), "covariance", "robot 0's covariance has a negative variance"),
    (broken.StandsStill(), "silence", "m from where odometry leads when nothing was sensed"),
    (broken.Confident(), "silence", "robot 0 grew surer when nothing was sensed"),
    (broken.DeclaresTooMuch(), "declaration", "declares anchor_rssi, landmark, and nothing of that ever changed"),
    (broken.HidesItsBill(), "declaration", "says it sent [0-9]+ messages of 0 bytes"),
    (broken.LovesTheOrigin(), "equivariance", "when the world was shifted"),
    (broken.LovesTheNorth(), "equivariance", "when the world was turned by 90 degrees"),
    (broken.FavoursRobotZero(), "equivariance", "robot [0-9]'s covariance is another when its robots were renumbered"),
    (broken.Lambda(scale=lambda v: v), "pickling", "cannot be pickled.*Can't pickle <function <lambda>>"),
    (broken.ForgetsParameter(drift=0.1), "pickling", "when it ran after a round trip through pickle"),
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
    report = check_estimator(estimator)
    assert report[check].status == "failed", report.table()
    assert re.search(words, report[check].detail), report[check].detail
    assert "\n" not in report[check].detail
    assert not report.passed
    if check == "runs":
        assert_ran(report, ["runs"])
        assert {r.detail for r in report.results[1:]} == {"it does not run"}


def test_the_gallery_has_something_for_every_check():
    assert {check for _, check, _ in GALLERY} == set(NAMES)
    assert [c.__name__.replace("_", "-") for c in CHECKS] == NAMES


RANDOM = {"arl", "rssi-pf", "mrsl-rssi", "mrsl-distance", "ctrn"}  # particles do not turn with the world


@pytest.mark.parametrize("seed", [0, 1])
@pytest.mark.parametrize("name", BUILTIN)
def test_built_in_estimators_pass(name, seed):
    estimator = make(name)
    report = check_estimator(estimator, name, seed)
    assert report.passed, report.table()
    exempt = ["non-interference"] * getattr(estimator, "bound", False) + ["equivariance"] * (name in RANDOM)
    assert_ran(report, [check for check in NAMES if check not in exempt])
    assert {r.seed for r in report.results} == {seed}


@pytest.mark.parametrize("cls", [broken.Broadcasts, broken.Averages, broken.Addressed, broken.HonestTeam])
@pytest.mark.parametrize("seed", [0, 1])
def test_honest_estimators_are_not_suspected(cls, seed):
    report = check_estimator(cls(), seed=seed)
    assert report.passed, report.table()
    assert_ran(report, NAMES)


@pytest.mark.parametrize("cls", [broken.BaseReader, broken.TeamBaseReader])
def test_following_an_array_to_its_base_finds_nothing_or_is_caught(cls):
    report = check_estimator(cls())
    honest = cls.__mro__[1]()
    for label in ("robots-1-3/n=3", "camera"):
        _, stream = simulate(label, trials=1, ticks=6)
        found = not np.array_equal(trace("base", cls(), stream).x, trace("honest", honest, stream).x)
        assert not found or report["causality"].status == "failed"


def test_a_bound_is_exempt_from_what_it_cannot_keep_and_the_report_says_so():
    report = check_estimator(make("ekf-joint"))
    assert report["non-interference"] == Result(
        "non-interference", "skipped", "it is a bound and sees the whole team by definition", 0
    )
    assert "radio readings of dropped packets changed nothing" in report["link-honesty"].detail
    seeing = check_estimator(SeeingBound())
    assert (seeing["link-honesty"].status, seeing.ran) == ("skipped", len(CHECKS) - 2)


@dataclasses.dataclass(frozen=True)
class SeeingBound(broken.EkfJoint):
    @property
    def uses(self):
        return ("odometry", "landmark", "sighting")


def test_the_report_is_the_same_every_time():
    for estimator in (make("mrsl-rssi"), broken.ReadsNeighbour(), broken.Lambda(scale=lambda v: v)):
        assert check_estimator(estimator) == check_estimator(estimator)


def test_checks_leave_global_randomness_alone():
    before = contents(np.random.get_state(), "numpy")  # noqa: NPY002
    check_estimator(make("mrsl-rssi"))
    assert contents(np.random.get_state(), "numpy") == before  # noqa: NPY002


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


# ---------------------------------------------------------------- what is done to a stream


@pytest.fixture(params=["robots-1-3/n=3", "camera", "linear"])
def stream(request):
    if request.param == "linear":
        return linear_team(seed=0, trials=2, robots=3, ticks=8)[1]
    return simulate(request.param, trials=2, ticks=8, drop=0.3)[1]


def changed(before, after):
    """By array, where something differs: (trial, tick, robot), or (trial, robot) for priors."""
    found = {}
    for name, a in before.arrays().items():
        b = after.arrays()[name]
        assert a.shape == b.shape
        lead = 2 if name.startswith("prior") else 3
        differs = ~((a == b) | ((a != a) & (b != b)))
        found[name] = differs.reshape(*differs.shape[:lead], -1).any(-1)
    return found


@pytest.mark.parametrize("how", perturb.HOW)
def test_only_the_readings_of_that_robot_and_time_are_disturbed(stream, how):
    rng = np.random.default_rng(0)
    for since in (0, 3):
        for name, where in changed(stream, perturb.disturbed(stream, how, rng, 1, since)).items():
            if name.startswith("prior."):
                assert not where[:, [0, 2]].any()
                assert where[:, 1].all() == (since == 0)
            elif name == "air.link":
                assert not where.any()
            else:
                assert not where[:, :, [0, 2]].any()
                assert not where[:, :since].any()
                there = np.isfinite(stream.arrays()[name]).reshape(*where.shape, -1).any(-1)
                np.testing.assert_array_equal(where[:, since:, 1], there[:, since:, 1])


def test_hidden_readings_are_gone_and_what_is_needed_to_move_stays(stream):
    hidden = perturb.disturbed(stream, "hidden", np.random.default_rng(0))
    for name, array in hidden.arrays().items():
        if name != "air.link":
            assert np.isfinite(array).all() if name in perturb.KEPT else np.isnan(array).all()
    assert np.linalg.eigvalsh(hidden.prior.P).min() > 0
    assert hidden.senses.dt.min() > 0


def test_links_are_cut_of_one_sender_or_all(stream):
    link = stream.air.link
    cut = perturb.silent(stream, sender=2, since=3).air.link
    assert not cut[:, 3:, :, 2].any()
    np.testing.assert_array_equal(cut[..., :2], link[..., :2])
    np.testing.assert_array_equal(cut[:, :3], link[:, :3])
    assert not perturb.silent(stream).air.link.any()
    other = perturb.relinked(stream, "shaken", np.random.default_rng(0), 3).air.link
    assert (other != link)[:, 3:].any()
    assert not other[..., range(3), range(3)].any()
    np.testing.assert_array_equal(other[:, :3], link[:, :3])


@pytest.mark.parametrize("how", perturb.HOW)
def test_radio_readings_are_disturbed_only_where_no_packet_came(how):
    _, stream = simulate("packet-drop", ticks=8)
    other = perturb.deaf_radio(stream, how, np.random.default_rng(0))
    for name in ("rssi", "range"):
        a, b = getattr(stream.air, name), getattr(other.air, name)
        np.testing.assert_array_equal((a != b) & ~np.isnan(a), ~stream.air.link & ~np.isnan(a))


def test_a_streams_own_copy_shares_no_memory(stream):
    copy = perturb.own(stream)
    assert copy.hashes == stream.hashes
    for name, array in copy.arrays().items():
        assert not array.flags.writeable
        assert not np.shares_memory(array, stream.arrays()[name])
    for name in ("arena", "anchors", "landmarks"):
        assert not np.shares_memory(getattr(copy.world, name), getattr(stream.world, name))
    assert contents(copy.world, "world") == contents(stream.world, "world")


def test_the_small_streams_hold_every_case():
    """Present and absent readings, ticks with all and with none, packets that came and that did not."""
    for stream in Bench("any", make("dead-reckoning"), seed=0).streams:
        assert not stream.air.link[:, :, range(stream.robots), range(stream.robots)].any()
        if stream.robots > 1:
            off = stream.air.link[..., ~np.eye(stream.robots, dtype=bool)]
            assert 0.5 < off.mean() < 0.9
        for channel in ("anchor_rssi", "landmark"):
            there = np.isfinite(getattr(stream.senses, channel))
            if there.size:
                assert 0.2 < there.mean() < 0.95
                assert there[:, 0].any()
                assert not there[:, 4].any()


# ---------------------------------------------------------------- bits


def test_the_sign_of_a_zero_is_a_difference():
    _, stream = simulate("robots-1-3/n=1", ticks=2)
    bench = Bench("any", make("dead-reckoning"), seed=0)
    a = bench.run(stream, "")
    b = a._replace(trace=dataclasses.replace(a.trace, P=a.trace.P.copy()))
    demand_same(a, b, stream, "nothing happened")
    b.trace.P[0, 1, 0, 0, 1] *= -1
    with pytest.raises(Failed, match=r"robot 0's estimate changed when this: 'robots-1-3/n=1.*trial 0, tick 1"):
        demand_same(a, b, stream, "this")


def test_contents_see_every_kind_of_change():
    def thing():
        return {
            "array": np.zeros(3),
            "objects": np.array([[1], "a"], dtype=object),
            "rng": np.random.default_rng(0),
            "nested": [(1, {2.0}), {"k": None}],
            "nan": float("nan"),
            "object": type("Box", (), {})(),
        }

    def seen(change):
        it = thing()
        it["object"].inside = 1
        before = contents(it, "it")
        change(it)
        after = contents(it, "it")
        return {path for path in {*before, *after} if before.get(path) != after.get(path)}

    assert seen(lambda t: None) == set()
    assert seen(lambda t: t["array"].__setitem__(1, -0.0)) == {"it['array']"}
    assert seen(lambda t: t["objects"][0].append(2)) == {"it['objects'][0][1]"}
    assert any("state" in path for path in seen(lambda t: t["rng"].normal()))
    assert seen(lambda t: t["nested"][0][1].add(3.0)) == {"it['nested'][0][1][1]"}
    assert seen(lambda t: setattr(t["object"], "inside", 2)) == {"it['object'].inside"}
    endless = []
    endless.append(endless)
    assert contents(endless, "it") == {"it": list}


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


def test_what_is_seldom_used_is_not_called_unused():
    found = check_estimator(make("ekf-ci"), "ekf-ci", seed=10)  # in whose small streams no fusion by range pays
    assert found.passed, found
