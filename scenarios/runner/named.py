"""The estimators that a caller of `run` means, by name."""

from collections.abc import Mapping
from typing import Any


def named(estimators: Mapping[str, Any] | Any) -> Mapping[str, Any]:
    """Instances by name: a mapping as it is, or one instance under the name of its class."""
    return estimators if isinstance(estimators, Mapping) else {type(estimators).__name__: estimators}
