"""What `PerRobot` and `PerTeam` share: a plain class's parameters, random numbers, radio; a tick as functions."""
