"""How the label of an estimator or a scenario becomes an object, and what an estimator says of itself."""
