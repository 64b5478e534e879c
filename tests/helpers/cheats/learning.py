"""Accidents with memory: what is learned in one trial goes on into the next."""

from typing import ClassVar

from counting import FILE, LATE, Counts


class LearnsInItsClass(Counts):
    """A class attribute goes on learning."""

    bias: ClassVar[float] = 0.0

    def extra(self, s, z):
        type(self).bias += 1e-3
        return self.bias


GLOBAL = {"bias": 0.0}


class LearnsInAGlobal(Counts):
    """A variable of the module goes on learning."""

    def extra(self, s, z):
        GLOBAL["bias"] += 1e-3
        return GLOBAL["bias"]


class LearnsInAFile(Counts):
    """A file goes on learning."""

    def extra(self, s, z):
        with FILE.with_suffix(".learned").open("a+") as file:
            file.write(".")
            return 1e-3 * file.tell()


class LearnsInADefault(Counts):
    """A mutable default argument goes on learning."""

    def extra(self, s, z, seen=[]):  # noqa: B006
        seen.append(1)
        return 1e-3 * len(seen)


class LearnsInLongRuns(Counts):
    """Remembers the end of long runs only, for the next long run."""

    end: ClassVar[float] = 0.0

    def extra(self, s, z):
        if s.tick > LATE:
            type(self).end += 1.0
        return self.end * (s.tick > LATE)


class LearnsFromOtherShapes(Counts):
    """A cache by the number of rows, warmed by runs of another size."""

    seen: ClassVar[set] = set()

    def extra(self, s, z):
        self.seen.add(len(s.x))
        return 1e-3 * any(size != len(s.x) for size in self.seen)
