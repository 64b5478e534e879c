"""Errors, consistency, intervals, comparisons. Add a statistic here."""
