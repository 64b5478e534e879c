"""Lines of reports/speed.md as words of a text."""

from pathlib import Path

from cooploc.estimators.plugins.errors import BadInput

PAGE = Path(__file__).parent / "speed.md"


def speed(what: str, decimals: int | None = None) -> str:
    """Of a line its median and range, or its median alone with so many decimals."""
    for line in PAGE.read_text(encoding="utf-8").splitlines():
        if line.startswith(f"| {what} | "):
            median, spread = line.removeprefix(f"| {what} | ").split(" | ")[:2]
            return f"{median} ({spread})" if decimals is None else f"{float(median):.{decimals}f}"
    raise BadInput(f"{PAGE} has no line {what!r}; make bench writes it")


def measured_on() -> str:
    """The processor, and the versions of what computes."""
    for line in PAGE.read_text(encoding="utf-8").splitlines():
        if " rounds; " in line:
            processor, versions, *_ = line.split("; ")
            return f"{processor}; {versions}"
    raise BadInput(f"{PAGE} does not say where it was measured; make bench writes it")
