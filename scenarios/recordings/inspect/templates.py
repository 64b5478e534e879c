"""Names of robots from the names of files: odom_red.csv and odom_blue.csv are odom_{robot}.csv of red and blue."""

import re
from collections import Counter
from collections.abc import Sequence
from typing import NamedTuple

MARK = "{robot}"


class Template(NamedTuple):
    """Files of one table."""

    file: str  # with {robot} where there is one for each
    robots: tuple[str, ...]  # in the order of the files


def template_of(files: Sequence[str], known: Sequence[str] = ()) -> Template:
    """The template that most files share; `known`: names of robots, for a single file."""
    if len(files) == 1:
        robot = next((name for name in known if name in _words(files[0])), "")
        return Template(_marked(files[0], robot) if robot else files[0], (robot,) if robot else ())
    counts = Counter(_marked(file, word) for file in files for word in dict.fromkeys(_words(file)))
    best = max(counts, key=lambda template: (counts[template], len(template)))
    if counts[best] < 2:
        return Template(files[0], ())
    robots = [word for file in files for word in _words(file) if _marked(file, word) == best]
    return Template(best, tuple(dict.fromkeys(robots)))


def _words(file: str) -> list[str]:
    return re.findall(r"[^/_\-. ]+", file.rpartition(".")[0])


def _marked(file: str, word: str) -> str:
    """The file's name with every appearance of a whole word replaced."""
    stem, dot, ending = file.rpartition(".")
    return re.sub(rf"(?<![^/_\-. ]){re.escape(word)}(?![^/_\-. ])", MARK, stem) + dot + ending
