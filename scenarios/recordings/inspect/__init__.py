"""A look at a recording that nobody has described: what is in it, what is odd about it, a log.toml to start from."""
