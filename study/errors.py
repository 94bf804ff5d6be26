"""What a user reads if something is wrong."""

from __future__ import annotations


class StudyError(Exception):
    """One line that says what is wrong and what to do about it."""


def listed(items: list[str]) -> str:
    """Returns "a, b and c"."""
    return " and ".join(filter(None, (", ".join(items[:-1]), items[-1])))
