"""Stamps and frames of trajectories in files: what is matched, and what is said of a path that fits otherwise."""

import re

import numpy as np
import pandas as pd
import pytest
from made_trajectories import frame_of, paths_of_all

from cooploc import BadInput
from cooploc.analysis.metrics.alignment import match_stamps, rotation
from cooploc.analysis.metrics.external import judge_trajectories
from cooploc.estimators.errors import shorten


@pytest.mark.parametrize("late", [0.0, 0.1, 1.5, -1.2])
def test_a_clock_that_is_off_by_enough_to_matter_is_noted(late):
    t, paths = paths_of_all()
    true, mine = (frame_of(t + s, paths[name]["red"]) for name, s in (("truth", 0.0), ("mine", late)))
    _, (_, *notes) = judge_trajectories(true, {"mine": mine})
    clocks = [note for note in notes if "stamps" in note]
    assert bool(clocks) == (abs(late) > 0.1)
    assert all(f"m with {-late:.3g} s added to its stamps: if clocks differ, add them" in note for note in clocks)


@pytest.mark.parametrize("scale", [1.0, 0.97, 0.5, 2.0])
def test_a_path_of_another_size_is_noted(scale):
    t, paths = paths_of_all()
    other = paths["mine"]["red"] * [scale, scale, 1]
    _, (_, *notes) = judge_trajectories(frame_of(t, paths["truth"]["red"]), {"mine": frame_of(t, other)}, align="se2")
    sizes = [note for note in notes if "lengths times" in note]
    assert bool(sizes) == (scale in (0.5, 2.0))
    assert all(
        float(note.partition("lengths times ")[2].partition(":")[0]) == pytest.approx(1 / scale, rel=0.02)
        for note in sizes
    )


def test_stamps_meet_as_by_brute_force():
    rng = np.random.default_rng(3)
    for _ in range(50):
        a, b = (np.sort(rng.uniform(0, 10, rng.integers(1, 30))) for _ in range(2))
        short, long = (b, a) if len(b) <= len(a) else (a, b)
        expected = [(int(np.abs(long - s).argmin()), k) for k, s in enumerate(short) if np.abs(long - s).min() <= 0.1]
        i, j = match_stamps(a, b, 0.1)
        found = zip(i.tolist(), j.tolist(), strict=True)
        assert [pair if len(b) <= len(a) else pair[::-1] for pair in found] == expected


def in_one_table(t, paths):
    return pd.concat([frame_of(t, x).assign(robot=robot) for robot, x in paths.items()], ignore_index=True)


def turned(x, angle):
    return np.column_stack([x[:, :2] @ rotation(angle).T + [3, 1], x[:, 2] + angle])


def held(x):
    """The pose of 10 s, to the last digit, for 6 s."""
    x = x.copy()
    x[100:161] = x[100]
    return x


def each(factors=(1, 1, 1), heading=0.0):
    """Return a change of the poses of every robot."""
    return lambda paths: {robot: x * factors + np.array([0, 0, heading]) for robot, x in paths.items()}


CHANGES = {  # of true paths and of estimated ones by robot, and what is said
    "none": (each(), each(), None),
    "frame": (
        each(),
        lambda own: {robot: turned(x, 0.7) for robot, x in own.items()},
        "mine errs by .*, and by .* once all robots are aligned together: .* --align team",
    ),
    "frame of each": (
        each(),
        lambda own: {robot: turned(x, 2.0 * k) for k, (robot, x) in enumerate(own.items())},
        "robot '.*' errs by .*: if it is in another frame, --align se2",
    ),
    "names": (each(), lambda own: dict(zip(own, list(own.values())[::-1], strict=True)), "are names exchanged"),
    "headings of y": (each(), each(heading=np.pi / 2), "headings that are off by -[89].* degrees"),
    "clockwise": (each(), each((1, 1, -1)), "headings that fit the truth with the other sign"),
    "mm": (each((1000, 1000, 1)), each((1000, 1000, 1)), r"truth: robot '.*' moves at \d+ m/s: are its lengths in m"),
    "held": (
        lambda true: {robot: held(x) for robot, x in true.items()},
        each(),
        r"truth: the poses of robot '.*' stay the same in 6 s, in which it moves \d.* m: leave them out",
    ),
}


@pytest.mark.parametrize(("of_truth", "of_mine", "said"), CHANGES.values(), ids=CHANGES)
def test_what_a_path_fits_otherwise_is_said(of_truth, of_mine, said):
    t, paths = paths_of_all()
    true, mine = of_truth(paths["truth"]), of_mine(paths["mine"])
    _, notes = judge_trajectories(in_one_table(t, true), {"mine": in_one_table(t, mine)})
    notes = [note for note in notes if "mine has no covariances" not in note]
    if said is None:
        assert notes == []
    else:
        assert notes
        assert [note for note in notes if not re.search(said, note)] == []


@pytest.mark.parametrize("late", [25.0, -25.0])
def test_a_clock_that_is_far_off_is_noted_where_stamps_meet(late):
    t, paths = paths_of_all()
    true, mine = (frame_of(t + s, paths[name]["red"]) for name, s in (("truth", 0.0), ("mine", late)))
    _, notes = judge_trajectories(true, {"mine": mine})
    assert any(f"with {-late:.3g} s added to its stamps" in note for note in notes)


@pytest.mark.parametrize("late", [7200.0, 1.7e9])
def test_of_clocks_that_share_no_time_it_is_said_what_to_add(late):
    t, paths = paths_of_all()
    true, mine = (frame_of(t + s, paths[name]["red"]) for name, s in (("truth", 0.0), ("mine", late)))
    with pytest.raises(BadInput, match=f"write both by one clock, such as with -{late:.0f}\\.0\\d s added to its own"):
        judge_trajectories(true, {"mine": mine})


def test_of_remarks_on_many_robots_a_few_are_said():
    clocks = [f"mine: robot 'r{k}' fits to {k / 7:.3g} m with -{k} s added" for k in range(10)]
    said = list(shorten(["a note", *clocks, "mine: robot 'r1' stands"]))
    assert said == ["a note", *clocks[:4], "6 more like the last", "mine: robot 'r1' stands"]


def test_a_robot_that_stands_where_it_was_known_to_be_is_judged():
    t, paths = paths_of_all()
    still = {"blue": 0 * paths["truth"]["blue"]}
    true, mine = (in_one_table(t, paths[name] | still) for name in ("truth", "mine"))
    rows, _ = judge_trajectories(true, {"mine": mine})
    assert rows.set_index("name")["rmse"]["blue"] == 0
    with pytest.raises(BadInput, match="poses of robot 'red' are the true ones"):
        judge_trajectories(true, {"mine": in_one_table(t, paths["truth"] | {"blue": paths["mine"]["blue"]})})


def test_headings_are_not_taken_for_degrees_where_those_of_the_truth_are_all_zero():
    t, paths = paths_of_all()
    true = frame_of(t, paths["truth"]["red"] * [1, 1, 0])  # as of a tracker of points
    spinning = paths["mine"]["red"] + np.linspace(0, 12, len(t))[:, None] * [0, 0, 1]
    rows, _ = judge_trajectories(true, {"mine": frame_of(t, spinning)})
    assert rows["rmse"].item() < 0.2
