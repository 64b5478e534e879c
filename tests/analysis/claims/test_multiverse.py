"""A ledger over the readings of its paper: equal specifications once, and what those that hold have in common."""

import numpy as np
import pandas as pd
import pytest
from made_errors import rows

import cooploc as cl
from cooploc.analysis.claims import interpretations, multiverse
from cooploc.analysis.claims.ledger import read
from cooploc.analysis.claims.multiverse import shared_assumptions
from cooploc.terminal.tables import show_interpretations as show

CLAIM = {"id": "1", "says": "better", "kind": "change", "of": "mrsl-rssi", "than": "arl", "scenarios": "nlos"}
ALL = {
    "sampling": {"says": "?", "letter": "box", "choices": {"walk": {}, "box": {"estimators": {"proposal": "box"}}}},
    "fusion": {
        "says": "?",
        "letter": "received",
        "choices": {"moments": {}, "received": {"estimators": {"fusion": "received"}}},
    },
    "anchors": {
        "says": "?",
        "letter": "direction",
        "choices": {"direction": {}, "RSSI": {"estimators": {"anchor_reading": "rssi"}, "settles": "window"}},
    },
    "window": {"says": "?", "letter": "5", "choices": {"5": {}, "1": {"estimators": {"M": "1", "K": "1"}}}},
    "prior": {
        "says": "?",
        "letter": "0.5",
        "only": "nlos",
        "choices": {"0.5": {}, "1": {"scenarios": {"prior_sigma": "1"}}},
    },
}
NOT_RUN = {"id": "2", "says": "exact", "kind": "level", "of": "ctrn", "scenarios": "robots-1-3", "size": 1.0}


def ledger(dimensions=ALL, **claim):
    return read({"paper": "p", "claims": [{**CLAIM, **claim}, NOT_RUN], "dimensions": dimensions}, "l.toml")


def made(asked, level, labels=("arl", "mrsl-rssi", "ctrn"), scenarios=("nlos",), trials=20):
    """Rows of all readings of a ledger; `level` gives the RMSE from an estimator's label and its reading."""
    noise, cells = np.random.default_rng(0), {}
    for one in interpretations.design(asked.dimensions):
        for where in scenarios:
            for label in labels:
                scenario = interpretations.scenario(where, one, asked.dimensions)
                cells[scenario, interpretations.estimator(label, one, asked.dimensions)] = level(label, one)
    hard = {scenario: noise.lognormal(0, 0.3, (trials, 1)) for scenario, _ in cells}
    frames = [
        rows(name, rmse**2 * hard[scenario] * noise.lognormal(0, 0.05, (trials, 1)), scenario=scenario, stream=scenario)
        for (scenario, name), rmse in cells.items()
    ]
    return pd.concat(frames, ignore_index=True)


def better_in_a_box(label, one):
    return 0.5 if label == "mrsl-rssi" and one["sampling"] == "box" else 1.1 if label == "mrsl-rssi" else 1.0


def test_the_sentence_names_the_one_choice_with_which_a_claim_holds():
    asked = ledger()
    found = cl.readings(made(asked, better_in_a_box), asked)
    boxes = (found["sampling"] == "box").sum()
    assert set(found.loc[found["sampling"] == "box", "verdict"]) == {"supported"}
    assert set(found.loc[found["sampling"] == "walk", "verdict"]) == {"contradicted"}
    (row,) = multiverse.shares(found).to_dict("records")
    assert (row["letter"], row["preset"]) == ("supported", "contradicted")
    assert row["supported"] == boxes < row["specifications"] == len(found)
    assert row["sentence"] == f"holds in {boxes} of {len(found)} specifications: all of them with sampling = box"


def test_equal_specifications_count_once_and_say_which_dimensions_matter():
    asked = ledger()
    found = cl.readings(made(asked, better_in_a_box), asked)
    case = multiverse.cases(asked.claims[0])[0]
    design = interpretations.design(asked.dimensions)
    labels = {multiverse.substitute(case, one, asked.dimensions) for one in design}
    assert len(found) == len(labels) < len(design)
    assert found["readings"].sum() == len(design)
    assert set(found["fusion"]) == {""}  # neither MRSL nor ARL has one
    assert set(found.loc[found["anchors"] == "RSSI", "window"]) == {""}
    assert multiverse.shares(found)["dimensions"].item() == "sampling, anchors, window, prior"
    assert found["letter"].sum() == found["preset"].sum() == 1


@pytest.mark.slow
def test_cases_with_the_same_numbers_count_once_and_so_do_the_definitions_of_a_size():
    """Signal strengths are the same in a world whose ranges alone are biased."""
    once, twice = ledger(size=-0.4), ledger(size=-0.4, scenarios=["nlos", "nlos/bias=0.5"])
    rows = made(once, better_in_a_box)
    twins = rows.assign(scenario=rows["scenario"].str.replace("nlos", "nlos/bias=0.5"))
    alone, both = cl.readings(rows, once), cl.readings(pd.concat([rows, twins], ignore_index=True), twice)
    pd.testing.assert_frame_equal(alone, both)
    assert set(both["definition"]) == {"change"}
    (row,) = multiverse.shares(both).to_dict("records")
    assert 0 < row["supported after Holm"] == (both["stands"] & (both["verdict"] == "supported")).sum()


def test_a_reading_whose_baseline_is_worse_than_dead_reckoning_is_implausible():
    """ARL errs by 1.0 m, in the box by 2.0 m; dead reckoning by 1.5 m."""

    def level(label, one):
        return {"dead-reckoning": 1.5, "mrsl-rssi": 0.5}.get(label, 2.0 if one["sampling"] == "box" else 1.0)

    asked = ledger()
    found = cl.readings(made(asked, level, ("arl", "mrsl-rssi", "dead-reckoning")), asked)
    assert ((found["sampling"] == "box") == found["implausible"]).all()
    np.testing.assert_allclose(found["error"] / 0.5, found["dead_reckoning"] / 1.5, rtol=0.2)
    (row,) = multiverse.shares(found).to_dict("records")
    assert 0 < row["implausible"] == found["implausible"].sum() < row["specifications"]


def test_a_dimension_of_one_method_is_read_in_its_claims():
    choices = {"range": {}, "RSSI": {"estimators": {"reading": "rssi"}}}
    measures = {"says": "?", "letter": "range", "only": "ctrn", "choices": choices}
    asked = ledger({"CTRN measures": measures}, of="ctrn", than="mrsl-distance")
    table = made(asked, lambda label, one: 0.5 if one["CTRN measures"] == "RSSI" else 1.0, ("ctrn", "mrsl-distance"))
    found = cl.readings(table, asked)
    assert found["CTRN measures"].tolist() == ["range", "RSSI"]
    assert set(table["estimator"]) == {"ctrn", "mrsl-distance", "ctrn[reading=rssi]"}


SHORT = {"s": "supported", "c": "contradicted", "d": "direction only", "u": "undecided"}


@pytest.mark.parametrize(
    ("verdicts", "columns", "sentence"),
    [
        ("ssss", {"a": "1122"}, "holds in all 4 specifications"),
        ("cccu", {"a": "1122"}, "holds in 0 of 4 specifications"),
        ("uuuu", {"a": "1122"}, "left open in all 4 specifications"),
        ("cddu", {"a": "1122"}, "holds in 0 of 4 specifications; its direction alone in 2"),
        ("sscccc", {"a": "112233"}, "holds in 2 of 6 specifications: all of them with a = 1"),
        ("sccccc", {"a": "112233"}, "holds in 1 of 6 specifications: the one with a = 1"),
        ("ssssdc", {"a": "112233"}, "holds in 4 of 6 specifications: the others are with a = 3"),
        ("scsccc", {"a": "112233"}, "holds in 2 of 6 specifications: all of them with a = 1 or 2"),
        ("sccccc", {"a": "112233", "b": "121212"}, "holds in 1 of 6 specifications: the one with a = 1"),
        ("scsc", {"a": "1122", "scenario": "xyxy"}, "holds in 2 of 4 specifications: all of them in x"),
        ("scsc", {"a": "1122"}, "holds in 2 of 4 specifications"),
    ],
)
def test_the_sentence_names_the_choices_that_set_the_holding_ones_apart(verdicts, columns, sentence):
    empty = dict.fromkeys(("scenario", "of", "than", "definition"), [""] * len(verdicts))
    given = {name: list(values) for name, values in columns.items()}
    part = pd.DataFrame({**empty, **given, "verdict": [SHORT[v] for v in verdicts]})
    assert shared_assumptions(part, [name for name in ("a", "b") if name in columns]) == sentence


@pytest.mark.slow
def test_the_command_prints_the_map_where_more_than_the_preset_was_run(capsys):
    asked = ledger()
    table = made(asked, better_in_a_box)
    show(cl.readings(table[table["estimator"].isin(["arl", "mrsl-rssi"]) & (table["scenario"] == "nlos")], asked))
    assert capsys.readouterr().out == ""
    show(cl.readings(table, asked))
    assert "1. better: holds in" in capsys.readouterr().out
