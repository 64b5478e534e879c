"""What the Kalman filters share: settings, updates of one belief and of a whole team, messages, compiled loops."""
