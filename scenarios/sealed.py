"""JSON objects that carry a checksum of their own content, so that no flipped bit goes unnoticed.

The checksum is over the values, written in one canonical way: indentation and the order of keys do not matter.
"""

import hashlib
import json
from collections.abc import Mapping
from typing import Any

CHECKSUM = "checksum"
SEALED = 2  # the first format whose objects have a checksum


class Damaged(ValueError):
    """What was read is not what was written; the message says why."""


def seal(content: Mapping[str, Any]) -> dict[str, Any]:
    """The object with its checksum."""
    return {**content, CHECKSUM: digest(content)}


def digest(content: object) -> str:
    """A SHA-256 over anything that JSON can hold."""
    plain = json.loads(json.dumps(content))  # as it is read again: every key a string
    return hashlib.sha256(json.dumps(plain, sort_keys=True, separators=(",", ":")).encode()).hexdigest()


def parsed(text: str | bytes) -> dict[str, Any]:
    """A JSON object, its checksum not yet compared.

    Raises:
        Damaged: it is not JSON, not an object, nested beyond reason, or holds text that no file can hold.

    """
    try:
        content = json.loads(text)
        json.dumps(content, ensure_ascii=False).encode()
    except (ValueError, RecursionError) as e:
        raise Damaged(f"it is not JSON ({' '.join(str(e).split())})") from None
    if not isinstance(content, dict):
        raise Damaged("it is not a JSON object")
    return content


def unsealed(content: Mapping[str, Any]) -> dict[str, Any]:
    """The object without its checksum; one of a format from before there were checksums, as it is.

    Raises:
        Damaged: the content does not match its checksum, or has none.

    """
    held = {key: value for key, value in content.items() if key != CHECKSUM}
    if CHECKSUM not in content and content.get("format", 1) == 1:
        return held
    if content.get(CHECKSUM) != digest(held):
        raise Damaged("its content does not match its checksum")
    return held
