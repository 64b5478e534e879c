"""The entry point: bad input becomes one line on stderr and exit code 2, never a traceback."""

import sys

INTERRUPTED = 130


def main() -> None:
    """Run the command line."""
    from cooploc.cli import app

    try:
        code = app(standalone_mode=False)
        if code == INTERRUPTED:  # typer has caught Ctrl-C
            _say("interrupted; what was finished is kept, and the same command goes on from there", code)
    except Exception as e:
        line = _explained(e)
        if line is None:
            raise
        code = _say(line, 2)
    sys.exit(code)


def _explained(e: Exception) -> str | None:
    """One line for what the user can fix; None for bugs of ours, which keep their traceback."""
    from cooploc.estimators.plugins.errors import BadInput

    if isinstance(e, BadInput):
        return str(e)
    if isinstance(e, OSError) and e.filename is not None:
        return f"{e.strerror or type(e).__name__}: {e.filename}; what was finished is kept"
    if hasattr(e, "format_message"):  # the command line's own errors, whose class typer does not export
        return f"{e.format_message()} (cooploc --help says what there is)"
    return None


def _say(message: str, code: int) -> int:
    from cooploc.terminal.visible import visible

    print("cooploc:", visible(" ".join(message.split())), file=sys.stderr)
    return code


if __name__ == "__main__":
    main()
