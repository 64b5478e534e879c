"""A robot's recording as CSV files, described by a `log.toml`."""
