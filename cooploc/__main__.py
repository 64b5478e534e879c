"""The entry point: what the user can fix becomes one line on stderr and exit code 2, never a traceback."""

import contextlib
import os
import re
import sys

INTERRUPTED = 130
KINDS = {"integer": "it must be a whole number", "number": "it must be a number"}  # in pydantic's words -> in ours
KEPT = "what was finished is kept, and the same command goes on from there"


def main() -> None:
    """Run the command line."""
    from cooploc.cli import app

    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(AttributeError):  # not a terminal's or a file's
            stream.reconfigure(errors="replace")  # type: ignore[union-attr]  # a question mark where it cannot show µ
    try:
        code = app(standalone_mode=False)
        if code == INTERRUPTED:  # typer has caught Ctrl-C
            _say(f"interrupted; {KEPT}")
        sys.stdout.flush()
    except Exception as e:
        line = _explain(e)
        if line is None:
            raise
        _say(line)
        code = 2
        try:  # output that cannot be written goes nowhere; else Python complains of it at its end
            sys.stdout.flush()
        except (OSError, ValueError):
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    sys.exit(code)


def _explain(e: BaseException) -> str | None:
    """Return one line for what the user can fix; None for bugs of ours, which keep their traceback."""
    from cooploc.estimators.errors import BadInput

    if isinstance(e, BadInput):
        return str(e)
    if isinstance(e, OSError):
        where = f": {e.filename}" if e.filename is not None else ""
        remedy = "ask for access, or name another place" if isinstance(e, PermissionError) else KEPT
        return f"{e.strerror or type(e).__name__}{where}; {remedy}"
    if isinstance(e, MemoryError):
        return f"out of memory; {KEPT}: with fewer --jobs, or where there is more memory"
    if hasattr(e, "format_message"):  # the command line's own errors, whose class typer does not export
        context = getattr(e, "ctx", None)
        command = context.command_path.rpartition("cooploc")[2] if context else ""
        said = re.sub(
            r"Input should be a valid (\w+),.*", lambda found: KINDS.get(found[1], found[0]), e.format_message()
        ).replace("Input should be greater than or equal to", "it must be at least")
        return f"{said} (cooploc{command} --help says what there is)"
    return None


def _say(message: str) -> None:
    from cooploc.terminal.console import make_console

    with contextlib.suppress(OSError):
        make_console(stderr=True).print("cooploc:", " ".join(message.split()))
        sys.stderr.flush()


if __name__ == "__main__":
    main()
