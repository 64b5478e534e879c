"""Processes of their own for plug-ins and for several jobs, and time limits."""
