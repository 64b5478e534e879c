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
SAMPLING = {
    "says": "around the present location",
    "letter": "box",
    "choices": {"walk": {}, "box": {"estimators": {"proposal": "box"}}},
}
FUSION = {
    "says": "covariance intersection",
    "letter": "received",
    "choices": {"moments": {}, "received": {"estimators": {"fusion": "received"}}},
}
ANCHORS = {
    "says": "direction of arrival",
    "letter": "direction",
    "choices": {
        "direction": {},
        "RSSI": {"estimators": {"anchor_reading": "rssi"}, "settles": "window"},
    },
}
WINDOW = {"says": "M", "letter": "5", "choices": {"5": {}, "1": {"estimators": {"M": "1", "K": "1"}}}}
PRIOR = {
    "says": "some uncertainty",
    "letter": "0.5",
    "only": "nlos",
    "choices": {"0.5": {}, "1": {"scenarios": {"prior_sigma": "1"}}},
}
ALL = {"sampling": SAMPLING, "fusion": FUSION, "anchors": ANCHORS, "window": WINDOW, "prior": PRIOR}
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


def test_a_claim_that_holds_with_one_choice_alone_is_said_to():
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


def test_a_claim_of_the_method_that_only_names_is_read_in_its_choices():
    measures = {
        "says": "not stated",
        "letter": "range",
        "only": "ctrn",
        "choices": {"range": {}, "RSSI": {"estimators": {"reading": "rssi"}}},
    }
    asked = ledger({"CTRN measures": measures}, of="ctrn", than="mrsl-distance")
    table = made(asked, lambda label, one: 0.5 if one["CTRN measures"] == "RSSI" else 1.0, ("ctrn", "mrsl-distance"))
    found = cl.readings(table, asked)
    assert found["CTRN measures"].tolist() == ["range", "RSSI"]
    assert set(table["estimator"]) == {"ctrn", "mrsl-distance", "ctrn[reading=rssi]"}


def specifications(**columns):
    n = len(columns["verdict"])
    empty = dict.fromkeys(("scenario", "of", "than", "definition"), [""] * n)
    short = {"s": "supported", "c": "contradicted", "d": "direction only", "u": "undecided"}
    return pd.DataFrame({**empty, **columns, "verdict": [short[v] for v in columns["verdict"]]})


@pytest.mark.parametrize(
    ("columns", "said"),
    [
        ({"verdict": "ssss", "a": "1122"}, "holds in all 4 specifications"),
        ({"verdict": "cccu", "a": "1122"}, "holds in 0 of 4 specifications"),
        ({"verdict": "uuuu", "a": "1122"}, "left open in all 4 specifications"),
        ({"verdict": "cddu", "a": "1122"}, "holds in 0 of 4 specifications; its direction alone in 2"),
        ({"verdict": "sscccc", "a": "112233"}, "holds in 2 of 6 specifications: all of them with a = 1"),
        ({"verdict": "sccccc", "a": "112233"}, "holds in 1 of 6 specifications: the one with a = 1 (1 of 2 such)"),
        ({"verdict": "ssssdc", "a": "112233"}, "holds in 4 of 6 specifications: the others are with a = 3"),
        (
            {"verdict": "scsccc", "a": "112233"},
            "holds in 2 of 6 specifications: all of them with a = any but 3 (2 of 4 such)",
        ),
        (
            {"verdict": "sccccc", "a": "112233", "b": "121212"},
            "holds in 1 of 6 specifications: the one with a = 1 and with b = 1",
        ),
        ({"verdict": "scsc", "a": "1122", "scenario": "xyxy"}, "holds in 2 of 4 specifications: all of them in x"),
        (
            {"verdict": "scscssuu", "a": "11223344"},
            "holds in 4 of 8 specifications: all of them with a = any but 4 (4 of 6 such)",
        ),
        ({"verdict": "scsc", "a": "1122"}, "holds in 2 of 4 specifications, whatever is chosen"),
        (
            {"verdict": "sssccccs", "a": "11112222"},
            "holds in 4 of 8 specifications; most often with a = 1 (3 of 4)",
        ),
    ],
)
def test_the_sentence_names_the_choices_that_set_the_holding_ones_apart(columns, said):
    part = specifications(**{name: list(values) for name, values in columns.items()})
    assert shared_assumptions(part, [name for name in ("a", "b") if name in columns]) == said


def test_the_command_prints_the_map_where_more_than_the_preset_was_run(capsys):
    asked = ledger()
    table = made(asked, better_in_a_box)
    show(cl.readings(table[table["estimator"].isin(["arl", "mrsl-rssi"]) & (table["scenario"] == "nlos")], asked))
    assert capsys.readouterr().out == ""
    show(cl.readings(table, asked))
    told = capsys.readouterr().out
    assert "1. better: holds in" in told
    assert "all of them with sampling = box" in told
