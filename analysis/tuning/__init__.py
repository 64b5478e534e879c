"""Tuning: every estimator gets the same budget of trials, on streams that no result is reported of."""
