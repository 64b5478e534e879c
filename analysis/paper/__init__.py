"""A run's figures, tables and references for a two-column paper in LaTeX."""
