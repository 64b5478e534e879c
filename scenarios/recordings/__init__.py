"""Recordings of real robots. Add a format here."""
