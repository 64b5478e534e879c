"""The one error for what a user can mend: an unknown name, a value out of bounds, a malformed file.

Its message is one line that states the fact, the place and the remedy; the command line prints it and exits with 2.
"""


class BadInput(ValueError):
    """Something that was asked for or given cannot be; says what, where, and what to do."""
