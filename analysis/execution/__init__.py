"""Studies on disk: plan, workers, run directories."""
