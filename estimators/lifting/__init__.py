"""What `PerRobot` and `PerTeam` share: a plain class's parameters, and random numbers for what draws globally."""
