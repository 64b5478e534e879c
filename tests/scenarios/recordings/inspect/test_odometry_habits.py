"""What is odd about the odometry of a team's files: found, and corrected by the setting that is drafted."""

import re

import numpy as np
import pandas as pd
import pytest
from made_csv_teams import ROBOTS, two_robots

import cooploc as cl
from cooploc import BadInput
from cooploc.analysis.plot.worlds import finding

pytestmark = pytest.mark.slow  # a second each; test_checks and test_infer_columns are quick


def test_speeds_to_the_side_are_said_as_no_turn_rate_has_them(tmp_path):
    for name, columns in two_robots(seconds=40).items():
        table = pd.DataFrame(columns).rename(columns={"v": "vx"})
        if "vx" in table:
            table["vy"] = 0.5 * table["vx"] * np.sin(table["time"])
        table.to_csv(tmp_path / name, index=False)
    inspected = cl.inspect(tmp_path).inspected
    (found,), text = inspected.findings, inspected.text
    assert (found.kind, found.table, found.sure) == ("sideways", "odometry", "likely")
    assert found.setting.startswith('kind = "displacement"')
    (tmp_path / "log.toml").write_text(text.replace('speed = "vx"', 'speed = { norm = ["vx", "vy"] }'))
    tables = [pd.read_csv(tmp_path / f"odom_{robot}.csv") for robot in ROBOTS]
    log = cl.inspect(tmp_path).inspected.log
    for robot, table in zip(ROBOTS, tables, strict=True):
        read = log.odometry[log.robots.index(robot)].values[:, 0]
        np.testing.assert_allclose(read, np.hypot(table["vx"], table["vy"]))
    (tmp_path / "log.toml").write_text(text.replace('x = "x"', 'x = { norm = ["x", "y"] }'))
    with pytest.raises(BadInput, match=r"truth.x: only a speed can be the norm of two columns; name one"):
        cl.inspect(tmp_path)


def write_team(folder, change):
    """The files of two robots, with odometry changed; their clean columns."""
    files = {name: pd.DataFrame(columns) for name, columns in two_robots(seconds=90).items()}
    for name, table in files.items():
        (change(table.copy()) if name.startswith("odom") else table).to_csv(folder / name, index=False)
    return files


def test_what_a_gyroscope_says_at_rest_is_found_and_subtracted(tmp_path):
    clean = write_team(tmp_path, lambda table: table.assign(omega=table["omega"] + 0.1))
    inspected = cl.inspect(tmp_path).inspected
    assert {f.kind for f in inspected.findings} == {"turn bias"}
    setting = {f.setting for f in inspected.findings}.pop()  # one for both robots
    found = {robot: float(value) for robot, value in re.findall(r"(\w+) = ([-\d.]+)", setting)}
    assert found == pytest.approx(dict.fromkeys(ROBOTS, 0.1), abs=0.02)
    (tmp_path / "log.toml").write_text(inspected.text.replace("[odometry]", f"[odometry]\n{setting}"))
    again = cl.inspect(tmp_path).inspected
    assert again.findings == ()
    for robot, series in zip(again.log.robots, again.log.odometry, strict=True):
        own = clean[f"odom_{robot}.csv"]
        np.testing.assert_allclose(series.values[:, 1], own["omega"] + 0.1 - found[robot])
    (tmp_path / "log.toml").write_text(inspected.text.replace("[odometry]", "[odometry]\nturn_bias = { green = 1.0 }"))
    with pytest.raises(BadInput, match="turn_bias names 'green'"):
        cl.inspect(tmp_path)


def rises(driven):
    """As a counter does, with nothing written for ten seconds."""
    return driven.where((driven.index < 300) | (driven.index > 400))


@pytest.mark.parametrize("leaps", [lambda driven: driven % 7, lambda driven: driven - 9.0 * (driven > 9), rises])
def test_a_counter_that_overflows_or_begins_again_goes_on(tmp_path, leaps):
    def counter(table):
        driven = (table.pop("v") * table["time"].diff().fillna(0)).cumsum()
        return table.assign(mileage=leaps(driven))

    clean = write_team(tmp_path, counter)
    inspected = cl.inspect(tmp_path).inspected
    assert any("the counter leaps" in f.fact for f in inspected.findings) == (leaps is not rises)
    for robot, series in zip(inspected.log.robots, inspected.log.odometry, strict=True):
        own = clean[f"odom_{robot}.csv"]
        driven = (own["v"] * own["time"].diff().fillna(0)).sum()
        assert np.ptp(series.values[:, 0]) == pytest.approx(driven, rel=0.05)  # but for the steps of the leaps


def on_change(table):
    """Lines for ten seconds, and then one every eight seconds."""
    return table[(table.index < 100) | (table.index % 80 == 0)]


@pytest.mark.parametrize(("change", "held"), [(lambda t: t.iloc[::50], 7.5), (on_change, 12.0)])
def test_speeds_that_are_written_seldom_hold_until_the_next(tmp_path, change, held):
    write_team(tmp_path, change)
    text = cl.inspect(tmp_path).inspected.text
    assert float(re.search(r"max_hold = ([\d.]+)", text)[1]) == held


def test_findings_on_turns_are_drawn_with_turn_rates_and_others_with_speeds(tmp_path):
    write_team(tmp_path, lambda table: table.assign(omega=table["omega"] + 0.1))
    inspected = cl.inspect(tmp_path).inspected
    one = inspected.findings[0]
    for kind, unit in (("turn bias", "turn rate [rad/s]"), ("jump", "speed, as read [m/s]")):
        figure = finding(one._replace(kind=kind), inspected.log, inspected.log)
        assert figure.axes[1].get_ylabel() == unit
        assert len(figure.axes[1].lines) == 2
    assert finding(one._replace(robot="", kind="sideways"), inspected.log, inspected.log) is None
