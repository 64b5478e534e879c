"""The checks that show what an estimator must not do."""
