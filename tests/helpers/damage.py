"""Ways in which a file can come to harm, drawn by hypothesis."""

from hypothesis import strategies as st

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
