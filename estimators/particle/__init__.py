"""What the particle filters share."""
