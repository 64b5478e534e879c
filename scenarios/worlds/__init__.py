"""Simulated worlds. Add one here."""
