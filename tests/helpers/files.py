"""Texts that tests change and folders that they look at."""

from pathlib import Path


def changed(text: str, old: str, new: str) -> str:
    """The text with one part of it, which occurs once, exchanged."""
    assert text.count(old) == 1, f"{old!r} must occur once in the text"
    return text.replace(old, new)


def contents(folder: Path) -> dict[str, bytes | None]:
    """Every path under a folder, hidden ones too, with a file's bytes or None for a folder."""
    return {
        str(path.relative_to(folder)): path.read_bytes() if path.is_file() else None
        for path in sorted(folder.rglob("*"))
    }
