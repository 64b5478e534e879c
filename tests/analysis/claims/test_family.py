"""The verdicts of a ledger together: p agrees with each, Holm bounds false ones, and their number is foreseen."""

from functools import partial

import numpy as np
import pandas as pd
import pytest
from made_errors import rows

from cooploc.analysis.claims import verdicts
from cooploc.analysis.claims.kinds import FALLS, decide
from cooploc.analysis.claims.ledger import read
from cooploc.analysis.claims.verdicts import DECIDED, JUDGED, adjust, judge
from cooploc.analysis.metrics.statistics import change, holm, p_of_change

SCENARIOS = [f"s/n={k}" for k in range(40)]
KINDS = {
    "change": {"than": "b"},
    "change of a size": {"than": "b", "size": -0.3},
    "trend": {},
    "all": {"than": "b"},
    "same": {"margin": 0.1},
    "growth": {"margin": 0.1},
    "interaction": {"than": "b"},
    "level": {"size": 1.1},
    "consistency": {},
    "time": {"size": 1e-4},
}


def ledger(**claims):
    return read({"paper": "p", "claims": [{"id": i, "says": "x", "of": "a", **one} for i, one in claims.items()]}, "l")


def run(rng, levels, trials=20, labels=SCENARIOS):
    """Rows of `a`, whose RMSE is a level in each scenario, and of `b`, whose RMSE is 1."""
    frames = []
    for label, level in zip(labels, levels, strict=True):
        hard = rng.lognormal(0, 0.3, (trials, 1))
        for name, rmse in (("a", level), ("b", 1.0)):
            frame = rows(name, rmse**2 * hard * rng.lognormal(0, 0.3, (trials, 1)), scenario=label, stream=label)
            own = rng.lognormal(0, 0.3, trials)
            frames.append(frame.assign(anees=1.4 * own, coverage95=0.87 + 0.02 * np.log(own), seconds=1e-4 * own))
    return pd.concat(frames, ignore_index=True)


@pytest.mark.parametrize("kind", KINDS)
def test_a_verdict_is_decided_where_its_p_is_at_most_five_percent(kind):
    """Ten groups of scenarios, whose truths lie around the edges of the zones."""
    rng = np.random.default_rng(1)
    groups = [SCENARIOS[k::10] for k in range(10)]
    table = run(rng, np.linspace(0.6, 1.25, 40))
    claims = {str(k): {"kind": kind.split()[0], "scenarios": group, **KINDS[kind]} for k, group in enumerate(groups)}
    found = judge(ledger(**claims), table)
    decided = found["verdict"].isin(DECIDED)
    assert found["verdict"].isin(JUDGED).all()
    assert ((found["p"] <= 0.05) == decided).all()
    assert decided.sum() > 0


def test_what_stands_is_decided_after_holm_over_all_rows_of_the_ledger():
    rng = np.random.default_rng(2)
    claims = {"1": {"kind": "change", "than": "b", "scenarios": SCENARIOS}, "2": {"kind": "level", "size": 1.0}}
    claims["2"]["scenarios"] = SCENARIOS
    found = judge(ledger(**claims), run(rng, np.linspace(0.7, 1.0, 40)))
    np.testing.assert_allclose(found["p_holm"], holm(found["p"].to_numpy()))
    assert (found["stands"] == (found["p_holm"] <= 0.05)).all()
    counted = verdicts.family_of(found)
    assert counted.judged == 80
    assert 0 < counted.stand < counted.decided < 80
    assert counted.at_most == pytest.approx(4.0)
    assert f"{counted.stand} of these stand" in str(counted)


def test_a_case_that_a_variant_leaves_as_it_is_counts_once():
    claim = {"id": "1", "says": "x", "kind": "change", "of": "a", "than": ["b", "c"], "scenarios": SCENARIOS[:5]}
    variant = {"other": {"estimators": {"c": "d"}}}
    table = run(np.random.default_rng(5), [0.9, 0.8, 0.7, 0.95, 1.0], labels=SCENARIOS[:5])
    others = [table[table["estimator"] == "b"].assign(estimator=name, mse=lambda t: 1.1 * t["mse"]) for name in "cd"]
    found = judge(read({"paper": "p", "claims": [claim], "variants": variant}, "l"), pd.concat([table, *others]))
    assert (len(found), verdicts.family_of(found).judged) == (20, 15)
    alike = found[found["than"] == "b"].sort_values(["scenario", "variant"])["p_holm"].to_numpy().reshape(5, 2)
    np.testing.assert_array_equal(alike[:, 0], alike[:, 1])
    different = found.drop_duplicates(["scenario", "of", "than"])
    np.testing.assert_allclose(different["p_holm"], holm(different["p"].to_numpy()))


def test_what_was_not_judged_is_not_in_the_family():
    missing = {"id": "1", "says": "x", "kind": "change", "of": "a", "than": "zz", "scenarios": "s/n=0"}
    made = read({"paper": "p", "claims": [missing, {"id": "2", "says": "x", "kind": "untestable", "why": "x"}]}, "l")
    found = judge(made, run(np.random.default_rng(3), [1.0], labels=SCENARIOS[:1]))
    assert verdicts.family_of(found) == (0, 0, 0, 0.0, 0.0)
    assert not found["stands"].any()
    assert "none is decided" in str(verdicts.family_of(found))


def judged_changes(rng, levels, trials=20):
    """The verdicts on "better" of a family of cases with these true ratios of errors."""
    found = []
    for level in levels:
        hard = rng.lognormal(0, 0.3, (trials, 1))
        a, b = (hard * rng.lognormal(0, 0.3, (trials, 2)) * [1.0, level**2]).T
        one = decide(change(a, b), trials, FALLS, partial(p_of_change, a, b))
        found.append({"verdict": one.verdict, "p": one.p})
    return adjust(
        pd.DataFrame(found).assign(claim="1", scenario=SCENARIOS[: len(found)], of="", than="", definition="")
    )


@pytest.mark.slow
def test_holm_bounds_the_chance_of_any_false_verdict_and_the_number_of_false_ones_is_foreseen():
    """Half of the truths lie at the edge of "better", where either verdict counts as false; the others far from it."""
    rng, repeats, half = np.random.default_rng(4), 200, 10
    wrong, standing, foreseen = [], [], []
    for _ in range(repeats):
        found = judged_changes(rng, [1.0] * half + [0.5] * half)
        false = found["verdict"].isin(DECIDED) & (found.index < half)
        wrong.append(false.sum())
        standing.append((false & found["stands"]).any())
        foreseen.append(verdicts.family_of(found).expected)
    assert np.mean(standing) < 0.05 + 3 * np.sqrt(0.05 * 0.95 / repeats)
    assert np.mean(wrong) < np.mean(foreseen) + 3 * np.std(wrong) / np.sqrt(repeats)
    assert np.mean(foreseen) < 0.05 * 2 * half  # fewer than if every truth lay at an edge
