"""What a notebook shows: well-formed tables."""

from xml.etree import ElementTree

import cooploc as cl


def test_a_table_of_a_stream_and_of_a_run_is_well_formed():
    stream = cl.simulate("packet-drop/drop=0.7", trials=2, seed=1, ticks=8)[1]
    run = cl.run({"<b>&": cl.make("ekf-naive"), "ekf-joint": cl.make("ekf-joint")}, stream)
    for held, expected in ((stream, {stream.hash[:16]}), (run, {"<b>&", "ekf-joint", "48", "centralised"})):
        table = ElementTree.fromstring(held._repr_html_())
        cells = " ".join("".join(cell.itertext()) for cell in table.iter() if cell.tag in ("td", "th", "caption"))
        assert all(one in cells for one in expected)
