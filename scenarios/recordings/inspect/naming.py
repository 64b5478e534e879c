"""What names of columns, files and topics say, by the words in `column_names.toml`: quantity, unit, side, robot."""

import re
import tomllib
from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Sequence
from fnmatch import fnmatchcase
from importlib.resources import files as resources
from itertools import pairwise, permutations, product
from unicodedata import normalize

from cooploc.scenarios.recordings.schema import UNITS
from cooploc.scenarios.recordings.text_files import NAMED_DATE

_WORDS = tomllib.loads((resources(__package__) / "column_names.toml").read_text("utf-8"))
QUANTITY, SIDE, UNIT, OTHERS, REMEDY = (
    {word: meaning for meaning, words in _WORDS[table].items() for word in words.split()}
    for table in ("quantities", "sides", "units", "others", "remedies")
)
QUANTITY_OF_PAIR = {pair: quantity for quantity, of in _WORDS["pairs"].items() for pair in of}
# Last words of what is not of a robot on a floor, or of a quaternion, or where something is.
AXES = {"turn_rate": (["x"], ["y"]), "speed": (["y"], ["z"]), "heading": (["x"], ["y"], ["w"]), "other": (["z"],)}
ESTIMATES = {word for word, kind in OTHERS.items() if kind == "estimates"}
NO_ROBOTS = "no_robots", "second_choice"
ODOMETRY, TRUTH = ({word for word, of in SIDE.items() if of == side} for side in ("odometry", "truth"))
CERTAIN = {*SIDE} - {"ground", "pos", "cap"}  # of these words that say it also in a file of the other side
# Words in names of files and topics of what robots saw.
SEEN = {"rel", "relative", "tag", "tags", "apriltag", "aruco", "marker", "markers", "detection", "detections", "camera"}
SEEN |= {"fiducial", "fiducials", "landmark", "landmarks", "sighting", "sightings", "seen"}
# The units of quantities in log.toml; all others are lengths in m.
SI = {
    "time": "s",
    "sec": "s",
    "nsec": "ns",
    "rssi": "dBm",
    "heading": "rad",
    "bearing": "rad",
    "turn": "rad",
    "angle": "rad",
}
RATES = {"turn_rate": "rad/s", "speed": "m/s"}


def words_of(name: str) -> list[str]:
    """Return the words of a name in small letters: camelCase, digits and signs divide it."""
    plain = normalize("NFKD", name).replace("μ", "u").encode("ascii", "ignore").decode()  # of µs
    plain = plain.replace("{robot}", " ").replace("{other}", " ").replace("dBm", "dbm")
    return [word.lower() for word in re.findall(r"[A-Za-z]+", re.sub(r"([a-z])([A-Z])", r"\1 \2", plain))]


def name_meaning(column: str) -> tuple[str, str, str]:
    """Return quantity, unit and side by a column's name, "" where unknown; a unit that does not fit is left out."""
    inside = re.search(r"[\[(]([^\])]*)[\])]", column.replace("°", "deg"))
    plain = re.sub(r"[\[(][^\])]*[\])]", " ", column)
    plain = re.sub(r"^(\W*p)_[A-Z]+_[A-Z]_", r"\1_", plain)  # p_WS_W_x is of a frame S, in one called W
    words = words_of(plain)
    pair = next((f"{a} {b}" for a, b in pairwise(words) if f"{a} {b}" in QUANTITY_OF_PAIR), "")
    known = [QUANTITY[word] for word in words if word in QUANTITY]
    names = [QUANTITY.get(word) for word in words_of(column.rpartition(".")[2])] if "." in column else []
    known = [quantity for quantity in names if quantity in ("robot", "other")] or known  # ranges.id names something
    unknown = "range" if "{other}" in column and words in (["r"], ["rho"]) else ""
    quantity = (
        QUANTITY_OF_PAIR[pair]
        if pair and "nothing" not in known
        else min(known, key=list(_WORDS["quantities"]).index, default=unknown)
    )
    if quantity == "nothing" or words[-1:] in AXES.get(quantity, ()):
        quantity = ""
    unit = next((UNIT[word] for word in (words_of(inside[1]) if inside else words[1:]) if word in UNIT), "")
    if quantity in RATES:
        unit = f"{unit}/s" if unit in (*UNITS["m"], *UNITS["rad"]) else unit * ("/" in unit)
    elif quantity in ("sec", "nsec") or unit not in UNITS[SI.get(quantity, "m")]:
        unit = ""
    return quantity, unit, side_of(plain)


def is_plain(column: str) -> bool:
    """Return whether a column's name is one word for a quantity, but for a unit: "range", "Distance (m)"."""
    return len(words_of(re.sub(r"[\[(].*", "", column))) == 1 and not re.search(r"\d", column)


def is_anchor(column: str) -> bool:
    """Return whether a column is about anchors."""
    return "anchors" in map(OTHERS.get, words_of(column))


def is_estimate(name: str) -> bool:
    """Return whether a file or column is what a filter wrote, and not called the truth; maps may be references."""
    found = ESTIMATES.intersection(words_of(name))
    return bool(found - {"slam", "cartographer", "gmapping"}) and side_of(name) != "truth"


def is_second_choice(column: str) -> bool:
    """Return whether a column says what was wanted or is not processed: it counts where no other has the quantity."""
    return "second_choice" in map(OTHERS.get, words_of(column))


def is_on_globe(column: str) -> bool:
    """Return whether a column holds degrees on the globe."""
    return bool({*words_of(column)} & {*_WORDS["others"]["globe"].split()})


def is_clockwise(column: str) -> bool:
    """Return whether a column holds angles of a compass: clockwise, from north."""
    return bool({*words_of(column)} & {*_WORDS["others"]["clockwise"].split()})


def side_of(name: str) -> str:
    """Return "truth" or "odometry" if words of a name speak of it, or of the globe; odometry, if of both."""
    return "truth" if is_on_globe(name) else min((SIDE[word] for word in words_of(name) if word in SIDE), default="")


# --- Whose something is


def columns_of_robots(head: Sequence[str], others: Collection[str] = ()) -> tuple[dict[str, str], tuple[str, ...]]:
    """Return the columns of a file that has some for each robot, with {robot} in their names, and the robots.

    red_x, red_y, blue_x, blue_y are {robot}_x and {robot}_y of red and blue; d12 is d{robot}{other} of 1 and 2. Two
    columns of motion or position must be there for every robot. No robot is called by a word of `others`.
    """
    words_at: dict[str, dict[str, str]] = {}  # pattern -> {robot: column}
    no_names = {*QUANTITY, *SIDE, *UNIT, *(word for word, kind in OTHERS.items() if kind in NO_ROBOTS), *others}
    for column in head:
        for match in re.finditer(r"\d+|[A-Za-z]+?(?=\d|[A-Z][a-z]|[^A-Za-z]|$)", column):
            if not (words := {*words_of(match[0])}) or words - no_names:
                pattern = f"{column[: match.start()]}{{robot}}{column[match.end() :]}"
                words_at.setdefault(pattern, {})[match[0]] = column
    teams: dict[frozenset[str], set[str]] = {}
    for pattern, of in words_at.items():
        if len(of) > 1 and name_meaning(pattern)[0] in ("x", "y", "speed", "turn_rate", "heading"):
            teams.setdefault(frozenset(of), set()).add(name_meaning(pattern)[0])
    team = max(teams, key=lambda team: (len(teams[team]), len(team)), default=frozenset[str]())
    if not any(teams.get(team, set()) >= needed for needed in ({"x", "y"}, {"speed", "turn_rate"})):
        return {}, ()
    of_team = [p for p, of in words_at.items() if {*of} == team]
    leftmost_last = sorted(of_team, key=lambda p: -p.index("{robot}"))  # of d1_A1 the first 1 is of the robot
    found = {column: p for p in leftmost_last for column in words_at[p].values()}
    if {"x", "y"} <= {name_meaning(column)[0] for column in head if column not in found and is_plain(column)}:
        return {}, ()  # beside x and y of a robot, m1x and m2x are of markers on it
    robots = tuple(dict.fromkeys(word for of in words_at.values() if {*of} == team for word in of))
    return found | pairs_of_robots(head, robots), robots


def pairs_of_robots(names: Iterable[str], robots: Sequence[str], quantity: str = "") -> dict[str, str]:
    """Return patterns of names with two robots: r12 is r{robot}{other} of 1 and 2, uwb_1_2 is uwb_{robot}_{other}.

    They are of ranges or RSSI by their words, or by the `quantity` that their file is about. Where d1_A1 stands beside
    d1_A2, A2 is an anchor.
    """
    fitting, names = dict[str, list[str]](), list(names)  # name -> its patterns
    for a, b in permutations(map(re.escape, robots), 2):
        pair = re.compile(rf"(?<![A-Za-z0-9]){a}(\D*?){b}(?![A-Za-z0-9])|(?<=[A-Za-z]){a}(\D*?){b}(?!\d)")
        for name in names:
            pattern = pair.sub(lambda m: f"{{robot}}{m[1] or m[2] or ''}{{other}}", name)
            meaning = name_meaning(pattern)[0] if pattern != name else ""
            about = quantity if meaning in ("", "robot", "other") else meaning  # "other" by the word "to"
            if pattern != name and about in ("range", "rssi"):
                itself = any(pattern.replace("{robot}", r).replace("{other}", r) in names for r in robots)
                if not (itself and re.search(r"\{robot\}.*[A-Za-z].*\{other\}", pattern)):
                    fitting.setdefault(name, []).append(pattern)
    often = Counter(pattern for patterns in fitting.values() for pattern in patterns)
    found = {name: max(some, key=often.__getitem__) for name, some in fitting.items()}  # tb_12 is not of 1 and 2
    own = {
        p.replace("{robot}", r).replace("{other}", r): p for p in {*found.values()} for r in robots
    }  # d11 beside d12
    return found | {name: own[name] for name in names if name in own}


def pairs_with_places(names: Iterable[str], robots: Sequence[str], places: Sequence[str]) -> dict[str, str]:
    """Return patterns of names with a robot and a place: /red/range_to/A1 is /{robot}/range_to/{other}.

    Of one robot alone its name need not be there. A pattern counts where it fits two places, if there are two.
    """
    found, fitting = dict[str, str](), dict[str, set[str]]()
    for name, robot, place in product(names, robots, places):
        whole, sign = re.escape(place), r"\d" if place.isdigit() else "[A-Za-z0-9]"
        pattern = re.sub(rf"(?<![A-Za-z0-9]){re.escape(robot)}(?![A-Za-z0-9])", "{robot}", name)
        other = re.sub(rf"(?<!{sign}){whole}(?!{sign})", "{other}", pattern)
        if other != pattern and ("{robot}" in pattern or len(robots) == 1):
            found[name] = other
            fitting.setdefault(other, set()).add(place)
    return {name: pattern for name, pattern in found.items() if len(fitting[pattern]) >= min(2, len(places))}


def pairs_by_number(names: Collection[str], robots: Sequence[str]) -> dict[str, str]:
    """Return patterns of names with a robot and the number of another: /tb_1/range_2 is /{robot}/range_{other}.

    Each robot has one of another, and none of itself: /tb_1/sonar_1 is of no other.
    """
    numbers, found = numbers_of(robots), dict[str, list[str]]()
    for name, pattern in pairs_with_places(names, robots, [*numbers]).items():
        found.setdefault(pattern, []).append(name)

    def is_of_mates(pattern: str) -> bool:
        there = [(a, numbers[n]) for a, n in product(robots, numbers) if pattern.format(robot=a, other=n) in names]
        return all({*ends} == {*robots} for ends in zip(*there, strict=True)) and all(a != b for a, b in there)

    return {name: p for p, some in found.items() if "{robot}" in p and is_of_mates(p) for name in some}


def numbers_of(robots: Iterable[str]) -> dict[str, str]:
    """Return robots by the last number in their names: 2 is robot2, or tb_02; none where two have the same."""
    last = {robot: str(int(number)) for robot in robots for number in re.findall(r"\d+", robot)[-1:]}
    return {number: robot for robot, number in last.items()} if len({*last.values()}) == len(last) else {}


def pattern_of_mates(columns: Sequence[str], own: str, robots: Sequence[str], fixed: Sequence[str]) -> str:
    """Return what a robot's columns are, if they end with teammates or places: uwb_to_2, uwb_to_A1 are uwb_to_{other}.

    If one is of a teammate, every teammate has one.
    """
    words = dict(zip(fixed, fixed, strict=True)) | numbers_of(robots) | {robot: robot for robot in robots}
    found: dict[str, set[str]] = {}
    for column in columns:
        before = {word: r"(?<!\d)" if word.isdigit() else r"(?<![A-Za-z0-9])" for word in words}
        ends = [word for word in words if re.search(f"{before[word]}{re.escape(word)}$", column)]
        for word in sorted(ends, key=len)[-1:]:
            found.setdefault(column[: -len(word)] + "{other}", set()).add(words[word])
    (pattern, things), *more = [*found.items()] or [("", set[str]())]
    whole = things & {*robots} in (set(), {*robots} - {own}) and len(things) == len(columns)
    return pattern if whole and not more else ""


def word_patterns(file: str, placeholder: str) -> Iterator[tuple[str, str]]:
    """Yield each word of a file's name, or up to three, and the name with a placeholder where these words are."""
    stem, dot, ending = file.rpartition(".")
    spans = [match.span() for match in re.finditer(r"[^/_\-. ]+", stem)]
    several = [stem[a:d] for (a, _), (_, d) in (*pairwise(spans), *zip(spans, spans[2:], strict=False))]
    names = [stem[a:b] for a, b in spans] + [name for name in several if name != stem and not {*"/ "} & {*name}]
    for word in dict.fromkeys(names):
        whole_word = rf"(?<![^/_\-. ]){re.escape(word)}(?![^/_\-. ])"
        yield word, re.sub(whole_word, placeholder, stem) + dot + ending


def file_pattern(files: Sequence[str], known: Sequence[str] = ()) -> tuple[str, tuple[str, ...]]:
    """Return the pattern that most files share, with {robot} in it, and the robots in the order of the files.

    odom_red.csv and odom_blue.csv are odom_{robot}.csv of red and blue; a name may be of up to three words, such as
    turtle_1. `known`: names of robots, for a single file.
    """
    patterns: dict[str, list[str]] = {}  # pattern -> the words that it stands for, of each file
    for file in files:
        for word, pattern in word_patterns(file, "{robot}"):
            patterns.setdefault(pattern, []).append(word)
    if len(files) == 1:
        patterns = {pattern: words for pattern, words in patterns.items() if words[0] in known}

    def order(pattern: str) -> tuple[int, bool, int]:
        is_part = "".join(patterns[pattern]).isdigit() and re.search(r"[A-Za-z]\d+[_\-. ]?\{robot\}", pattern)
        return len(patterns[pattern]), not is_part, len(pattern)  # of tb3_0 the robot is not 0

    best = max(patterns, key=order, default=files[0])
    robots = patterns.get(best, [])
    return (best, tuple(dict.fromkeys(robots))) if len(robots) > 1 or len(files) == len(robots) else (files[0], ())


def without_dates(files: Sequence[str]) -> dict[str, str]:
    """Return names of files, or folders, with * in place of when they were written, where the rest is of one alone."""
    starred = {file: NAMED_DATE.sub("*", file) for file in files}
    whole = {
        file: star
        for file, star in starred.items()
        if star != file and re.search("[A-Za-z]", star.rpartition(".")[0] or star)
    }
    return {f: s for f, s in whole.items() if sum(fnmatchcase(other, s.replace("[", "[[]")) for other in files) == 1}


def match_names(words: Iterable[str], robots: Sequence[str]) -> dict[str, str]:
    """Return the robots that words mean, by equal letters and digits, else last number, last word, or first word.

    A robot that is among the words by its own name is not meant by another: beside robot1, a1 is an anchor. As many
    numbers as robots, but for one more or less each, are theirs in order: 1, 2 and 3 of tb3_0, tb3_1 and tb3_2; where
    robots are called by numbers, if one of both counts from 0.
    """
    found, words = dict[str, str](), list(dict.fromkeys(words))
    nameless, numbers, own = [r for r in robots if r not in words], numbers_of(robots), numbers_of(words)
    if len(own) == len(words) == len(numbers) > 1 and len({re.sub(r"\d+$", "", word) for word in words}) == 1:
        counted, known = (sorted(map(int, some)) for some in (own, numbers))
        is_next = [n - counted[0] for n in counted] == [n - known[0] for n in known] and abs(counted[0] - known[0]) == 1
        if is_next and (len(nameless) == len(words) or 0 in (counted[0], known[0])):
            return {own[str(a)]: numbers[str(b)] for a, b in zip(counted, known, strict=True)}
    forms = (
        letters_of,
        lambda name: "".join(map(str, map(int, re.findall(r"\d+", name)[-1:]))),
        lambda name: "".join(re.findall(r"[^\W_]+", name)[-1:]).lower(),
        lambda name: "".join(re.findall(r"[^\W_]+", name)[:1]).lower(),
    )
    for form in forms:
        for word in words:
            alike = [r for r in nameless if form(word) and form(r) == form(word) and r not in found.values()]
            if word not in robots and word not in found and len(alike) == 1:
                found[word] = alike[0]
    return found


def letters_of(name: str) -> str:
    """Return the letters and digits of a name, in small letters."""
    return re.sub(r"[\W_]", "", name).lower()


def clean_name(word: str) -> str:
    """Return a name for a word in a file: blanks, and signs that a name cannot have, become _."""
    return re.sub(r"[\s,/{}\[\]]", "_", word)
