"""The claims of a paper, and the verdict on each. Add a claim to `claims.toml`."""
