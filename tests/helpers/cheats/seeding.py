"""Accidents with randomness: numbers that come from the process, the clock or the order of a set."""

import datetime
import os
import time

import numpy as np
from counting import Counts

YEAR = datetime.date.today().year


class SeedsFromHash(Counts):
    """`hash()` of text differs from process to process."""

    def extra(self, s, z):
        return np.random.default_rng(hash("particles") % 2**32).normal(size=2)


class OrderOfASet(Counts):
    """The order of a set of names differs from process to process."""

    def extra(self, s, z):
        order = [ord(letter) for letter in set("abcdefghijklmnopqrstuvwxyz")]
        return 1e-3 * float(np.dot(order, range(len(order))))


class SeedsFromProcess(Counts):
    """The process id."""

    def extra(self, s, z):
        return np.random.default_rng(os.getpid()).normal(size=2)


class SeedsFromDate(Counts):
    """Today's date."""

    def extra(self, s, z):
        return np.random.default_rng(datetime.date.today().toordinal()).normal(size=2)


class SeedsFromYear(Counts):
    """The year by `datetime.now`."""

    def extra(self, s, z):
        return 1e-3 * datetime.datetime.now().year


class SeedsFromLocalTime(Counts):
    """The year by `time.localtime`."""

    def extra(self, s, z):
        return 1e-3 * time.localtime().tm_year


class SeedsFromItsImport(Counts):
    """The year in which its file was imported."""

    def extra(self, s, z):
        return 1e-3 * YEAR


class SeedsFromDirectory(Counts):
    """The working directory."""

    def extra(self, s, z):
        return np.random.default_rng(list(os.getcwd().encode())).normal(size=2)


class SeedsFromClock(Counts):
    """The clock."""

    def extra(self, s, z):
        return np.random.default_rng(time.perf_counter_ns()).normal(size=2)


class SeedsFromNothing(Counts):
    """A generator without a seed."""

    def extra(self, s, z):
        return np.random.default_rng().normal(size=2)
