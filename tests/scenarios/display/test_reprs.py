"""What a user holds is, in a notebook, a small table that is well-formed."""

from xml.etree import ElementTree

import pytest

import cooploc as cl
from cooploc.analysis.claims import ledger


@pytest.fixture(scope="module")
def held():
    truth, stream = cl.simulate("packet-drop/drop=0.7", trials=2, seed=1, ticks=8)
    run = cl.run({"<b>&": cl.make("ekf-naive"), "ekf-joint": cl.make("ekf-joint")}, stream)
    return {"truth": truth, "stream": stream, "run": run, "ledger": ledger.load()}


def test_a_table_holds_what_is_there(held):
    told = {}
    for what in ("stream", "run", "ledger"):
        table = ElementTree.fromstring(held[what]._repr_html_())
        told[what] = ["".join(cell.itertext()) for cell in table.iter() if cell.tag in ("td", "th", "caption")]
    link = held["stream"].air.link
    assert f"{link.sum() / (link[..., 0].size * 4):.0%}" in told["stream"]
    assert held["stream"].hash[:16] in told["stream"]
    assert {"<b>&", "ekf-joint", "48", "centralised"} <= set(told["run"])
    assert {claim.says for claim in held["ledger"].claims} <= set(told["ledger"])
