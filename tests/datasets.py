"""What tests look at of datasets on disk."""


def contents(directory):
    """Return the bytes of all files below a directory but the locks, by name, in order."""
    files = (p for p in sorted(directory.rglob("*")) if p.is_file() and p.name != ".lock")
    return {p.relative_to(directory).as_posix(): p.read_bytes() for p in files}
