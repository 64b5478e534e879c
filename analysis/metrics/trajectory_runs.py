"""Trajectories of several runs, or trials, which are judged together: each is matched with its own truth.

Runs are folders that are called so (`run1`, `trial_02`), words in the names of files (`trial7-red.txt`, `red_run3.csv`)
or the values of a column (`trial`) of one table. Methods have them under the same words.
"""

import re
from collections.abc import Mapping
from pathlib import Path
from tempfile import TemporaryDirectory, mkdtemp

import pandas as pd

from cooploc.analysis.metrics.alignment import Matched, match_trajectories, place_of_truth
from cooploc.analysis.metrics.trajectory_bags import TRUTH
from cooploc.analysis.metrics.trajectory_files import COVARIANCE, ENDINGS, PLACES, STORED
from cooploc.estimators.errors import BadInput, first_of, shorten
from cooploc.scenarios.recordings.inspect.naming import words_of
from cooploc.scenarios.recordings.inspect.runs import are_runs, is_run_column
from cooploc.scenarios.recordings.text_files import RUN_WORDS, are_called_runs, is_text, read_text, split_fields

Place = str | Path | pd.DataFrame
BAGS = ".bag", ".mcap", ".db3"
IN_NAMES = re.compile(rf"(?<![a-z])(?:{'|'.join(RUN_WORDS)})[-_ ]?\d+(?!\d)", re.IGNORECASE)


def match_runs(
    truth: Place, estimates: Mapping[str, Place], align: str, axes: str, largest: float
) -> tuple[dict[str, Matched], tuple[str, ...]]:
    """Return the matched trajectories of each run by its name, of one recording under "", and remarks on all.

    Only runs count that every method has. The arguments are those of `external.judge_trajectories`.
    """
    with TemporaryDirectory() as folder:
        own = re.compile(rf"{re.escape(folder)}/[^/]*/")  # of tables and links; messages name what is in it alone
        try:
            found, remarks = _match_each(truth, estimates, align, axes, largest, Path(folder))
        except BadInput as e:
            raise BadInput(own.sub("", str(e))) from None
    return found, tuple(own.sub("", remark) for remark in remarks)


def _match_each(
    truth: Place, estimates: Mapping[str, Place], align: str, axes: str, largest: float, folder: Path
) -> tuple[dict[str, Matched], list[str]]:
    true, word = place_of_truth(_as_path(TRUTH, truth, folder))
    places = {name: _as_path(name, place, folder) for name, place in estimates.items()}
    runs = runs_in(true, folder)
    each = {name: runs_in(place, folder) for name, place in places.items()} if runs else {}
    if len(runs) < 2:
        for run, place in runs.items():
            if place.parent == true and all(run in there for there in each.values()):  # run1/ alone
                true, places = place, {name: there[run] for name, there in each.items()}
        one = match_trajectories(true, word, places, align, axes, largest)
        return {"": one}, list(one.remarks)
    remarks = []
    for name, there in each.items():
        if lost := [run for run in runs if run not in there]:
            if len(lost) == len(runs):
                place, of = places[name], first_of(runs)
                has = f"{place} has none of the runs {of}, which the truth has; call its folders or files so"
                raise BadInput(has if place.exists() else f"there is no folder {place}; name the one with its runs")
            remarks.append(f"{name} lacks {first_of(lost)}: judged is what all have")
        if more := [run for run in there if run not in runs]:
            remarks.append(f"{name} has {first_of(more)}, and the truth has not: are both numbered alike?")
    found, said = dict[str, Matched](), dict[str, list[str]]()
    for run in [run for run in runs if all(run in there for there in each.values())]:
        of_run = {name: there[run] for name, there in each.items()}
        one = match_trajectories(runs[run], word, of_run, align, axes, largest)
        found[run] = one._replace(label=true.resolve().name)
        for remark in one.remarks:
            said.setdefault(remark, []).append(run)
    if len(found) < 2:
        raise BadInput(f"{true}: {len(found)} of its {len(runs)} runs has every method; name that run's files alone")
    robots = {robot for one in found.values() for robot in one.paths}
    if len(robots) > max(len(one.paths) for one in found.values()) == 1:  # run1.txt, run2.txt of one robot
        found = {run: _renamed(one, "robot") for run, one in found.items()}
    remarks += [f"{first_of(of)}: {remark}" if len(of) < len(found) else remark for remark, of in said.items()]
    return found, list(shorten(remarks))


def _renamed(one: Matched, robot: str) -> Matched:
    """Return the trajectories of the only robot by another name."""
    (path,), teams = one.paths.values(), {name: {robot: next(iter(of.values()))} for name, of in one.teams.items()}
    return one._replace(paths={robot: path}, teams=teams)


def _as_path(name: str, where: object, folder: Path) -> Path:
    """Return where trajectories lie; a table is written into the folder first."""
    if isinstance(where, pd.DataFrame):
        path = Path(mkdtemp(dir=folder)) / (re.sub(r"[^\w-]", "_", name) + ".csv")
        where.to_csv(path, index=where.index.name is not None)
        return path
    if not isinstance(where, str | Path):
        raise BadInput(f"{name} is a {type(where).__name__}; name a folder, file or bag, or give a pandas.DataFrame")
    return Path(where)


def runs_in(place: Path, folder: Path) -> dict[str, Path]:
    """Return where the trajectories of each run are, by its name; none where no name says run or trial.

    What is not a folder of its own is linked, or written, into `folder`.
    """
    if place.is_file():
        return _runs_of_table(place, folder) if is_text(place) else {}
    there = [path for path in place.iterdir() if path.name[0] != "."] if place.is_dir() else []
    files = [path for path in there if path.is_file()]
    poses = [p for p in files if p.suffix in (*ENDINGS, *BAGS) and COVARIANCE not in p.name]
    named = {path: m[0] for path in files if (m := IN_NAMES.search(path.name))}
    found: dict[str, Path] = {}
    if not poses:
        folders = [path for path in there if path.is_dir()]
        runs = [path for path in folders if are_called_runs([path.name])]
        found = {_key(path.name): path for path in runs} if len(runs) > 1 or runs == folders else {}
        if found and len(found) < len(runs):
            raise BadInput(
                f"{place}: two of its folders are of one run ({', '.join(p.name for p in runs)}); rename one"
            )
    elif all(path in named or PLACES & {*words_of(path.stem)} for path in poses):
        for path in files:
            homes = [_key(named[path])] if path in named else {_key(word) for word in named.values()}
            for run in homes if path in named or path.name == STORED else ():
                if run not in found:
                    found[run] = Path(mkdtemp(dir=folder))
                (found[run] / path.name).symlink_to(path.resolve())
    return {run: found[run] for run in sorted(found, key=_in_order)}


def _runs_of_table(path: Path, folder: Path) -> dict[str, Path]:
    """Return a file for each run of a table with a column of runs."""
    text = read_text(path)
    head = split_fields(text[:100_000])[0]
    column = next((k for k, name in enumerate(head) if is_run_column(name)), None)
    if column is None:
        return {}
    _, _, rows = split_fields(text)
    lines: dict[str, list[list[str]]] = {}
    for _, fields in rows:
        if len(fields) == len(head) and fields[column].strip():
            lines.setdefault(_key(f"{words_of(head[column])[0]} {fields[column]}"), []).append(fields)
    if not are_runs(run for run, own in lines.items() for _ in own):
        return {}
    home, kept = Path(mkdtemp(dir=folder)), [k for k in range(len(head)) if k != column]
    for run, own in lines.items():
        (home / run).mkdir()
        table = pd.DataFrame([[fields[k] for k in kept] for fields in own], columns=[head[k] for k in kept])
        table.to_csv(home / run / f"{path.stem}.csv", index=False)
    return {run: home / run / f"{path.stem}.csv" for run in sorted(lines, key=_in_order)}


def _key(name: str) -> str:
    """Return a run's name without signs and leading zeros: run1 of Run_01."""
    return re.sub(r"(?<!\d)0+(?=\d)", "", re.sub(r"[^a-z0-9.]", "", name.lower())).removesuffix(".0")


def _in_order(run: str) -> list[tuple[int, str]]:
    """Return what sorts run2 before run10."""
    return [(int(part), "") if part.isdigit() else (0, part) for part in re.split(r"(\d+)", run)]
