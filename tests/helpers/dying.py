"""A process that ends at a file operation of one's choice, as if the power had failed just before it."""

import os
import sys

NAMES = "mkdir", "rename", "remove", "rmdir", "listdir", "scandir", "chmod", "truncate"
WATCHED = {"open", *(f"os.{name}" for name in NAMES)}
EXIT = 77


def die_at(number, folder):
    """End this process just before its so-manieth operation on anything in a folder; 0 never ends it."""
    seen = 0

    def watch(event, arguments):
        nonlocal seen
        if event in WATCHED and any(folder in str(each) for each in arguments[:2]):
            seen += 1
            if seen == number:
                os._exit(EXIT)

    sys.addaudithook(watch)
