"""Limits of parameters, so that a slip of the keyboard is refused at once instead of filling the memory for hours."""

from typing import Any


def require(owner: Any, **limits: tuple[float, float]) -> None:
    """Refuse parameters outside their limits, both included; nan is outside of any.

    Raises:
        ValueError: names the parameter, its value and the limits.

    """
    for name, (low, high) in limits.items():
        value = getattr(owner, name)
        if not low <= value <= high:
            least, most = f"at least {low:g}", f"at most {high:g}"
            raise ValueError(
                f"{name} is {value}; it must be {least if value < low else most if value > high else 'a number'}"
            )
