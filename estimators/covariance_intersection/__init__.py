"""Covariance intersection: the weights of least trace or determinant, exact and by cvxpy."""
