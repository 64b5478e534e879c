"""Studies: scenarios x estimators x trials. The shipped ones are the TOML files in this folder."""
