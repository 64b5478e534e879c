"""The runner: feeds one stream to any number of estimators and carries their mail."""
