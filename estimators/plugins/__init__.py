"""How the name of an estimator or a scenario becomes an object: built-in, installed plug-in, or a file."""
