"""Ways in which a file can come to harm, drawn by hypothesis."""

from hypothesis import strategies as st

JSON = st.recursive(
    st.one_of(st.none(), st.booleans(), st.integers(-(10**20), 10**20), st.floats(), st.text(max_size=8)),
    lambda inner: st.one_of(st.lists(inner, max_size=3), st.dictionaries(st.text(max_size=8), inner, max_size=3)),
    max_leaves=5,
)
HARM = st.tuples(
    st.sampled_from(["flip", "flip", "flip", "flip", "cut", "insert", "zero", "garbage", "empty", "remove", "folder"]),
    st.floats(0, 1, exclude_max=True),
    st.integers(0, 7),
    st.binary(min_size=1, max_size=20),
)


def harmed(content, harm):
    """The bytes after one of the ways that leave a file; where along it, which bit, and what is written are drawn."""
    kind, where, bit, junk = harm
    at = int(where * len(content))
    if kind == "flip" and content:
        return content[:at] + bytes([content[at] ^ 1 << bit]) + content[at + 1 :]
    written = {
        "cut": content[:at],
        "insert": content[:at] + junk + content[at:],
        "zero": content[:at] + bytes(len(content) - at),
        "garbage": junk,
    }
    return written.get(kind, b"")


def harm_file(file, harm):
    """Do it to a file."""
    content = file.read_bytes()
    file.unlink()
    if harm[0] == "folder":
        file.mkdir()
    elif harm[0] != "remove":
        file.write_bytes(harmed(content, harm))


def changed(content, where, value):
    """JSON with one of its values, at any depth, replaced or (where the value is None) left out."""
    if not isinstance(content, dict | list) or not content:
        return value
    keys = list(content) if isinstance(content, dict) else list(range(len(content)))
    key, rest = keys[int(where[0] * len(keys))], where[1:]
    inner = changed(content[key], rest, value) if rest else value
    if isinstance(content, list):
        return [*content[:key], inner, *content[key + 1 :]]
    if inner is None and not rest:
        return {k: v for k, v in content.items() if k != key}
    return {**content, key: inner}


PLACES = st.lists(st.floats(0, 1, exclude_max=True), min_size=1, max_size=5)
