"""Of what kind the values of a JSON file are: checks, made of smaller ones."""

import math
import re
from collections.abc import Callable, Mapping
from typing import Any

Check = Callable[[Any, str], None]
"""Takes a value and where it stands; raises ValueError that says where and what is expected."""

# JSON can name them, UTF-8 has none
_SURROGATE = re.compile("[\ud800-\udfff]")
_LONGEST_NAME, _LONGEST_SHOWN = 1000, 40


def text(value: Any, where: str) -> None:
    """A text of any length, which a file in UTF-8 can hold."""
    _expect(isinstance(value, str), value, where, "a text")
    _expect(not _SURROGATE.search(value), value, where, "a text in Unicode")


def name(value: Any, where: str) -> None:
    """A text that fits into a picture."""
    text(value, where)
    _expect(len(value) <= _LONGEST_NAME, value, where, "a short text")


def number(value: Any, where: str) -> None:
    """A finite number that is no bool."""
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    # an int may be larger than any float
    _expect(is_number and _is_float(value), value, where, "a number")


def count(value: Any, where: str) -> None:
    """A whole number."""
    is_whole = isinstance(value, int) and not isinstance(value, bool)
    _expect(is_whole and _is_float(value), value, where, "a whole number")


def truth(value: Any, where: str) -> None:
    """A bool."""
    _expect(isinstance(value, bool), value, where, "true or false")


def anything(value: Any, where: str) -> None:
    """Whatever it is."""


def absent_or(check: Check) -> Check:
    """None, or what the check takes."""

    def check_it(value: Any, where: str) -> None:
        if value is not None:
            check(value, where)

    return check_it


def entries(check: Check, least: int = 0, most: int | None = None) -> Check:
    """A list of so many values, all of which the check takes."""

    def check_it(value: Any, where: str) -> None:
        _expect(isinstance(value, list), value, where, "a list")
        fits = least <= len(value) and (most is None or len(value) <= most)
        _expect(fits, value, where, f"a list of {least if most == least else f'{least} or more'}")
        for place, each in enumerate(value):
            check(each, f"{where}[{place}]")

    return check_it


def table(check: Check) -> Check:
    """Any names, with values that the check takes."""

    def check_it(value: Any, where: str) -> None:
        _expect(isinstance(value, dict), value, where, "a table")
        for key, each in value.items():
            check(each, f"{where}.{_shown(key)}")

    return check_it


def fields(needed: Mapping[str, Check], others: Mapping[str, Check] | None = None) -> Check:
    """Values by their names, those that are needed and others that may be missing."""
    checks = {**needed, **(others or {})}

    def check_it(value: Any, where: str) -> None:
        _expect(isinstance(value, dict), value, where or "all of it", "a table")
        for key in needed:
            if key not in value:
                raise ValueError(f"{where or 'it'} has no {key!r}")
        for key, check in checks.items():
            if key in value:
                check(value[key], f"{where}.{key}" if where else key)

    return check_it


def _is_float(value: float) -> bool:
    try:
        return math.isfinite(float(value))
    except OverflowError:
        return False


def _expect(is_met: bool, value: Any, where: str, expected: str) -> None:
    if not is_met:
        raise ValueError(f"{where} is {_shown(value)}, not {expected}")


def _shown(value: Any) -> str:
    """The beginning of a value, on one line."""
    kind = {list: "a list", dict: "a table", type(None): "null"}.get(type(value))
    if isinstance(value, int) and not _is_float(value):
        kind = "too large"
    if kind is not None:
        return kind
    shown = ascii(value) if isinstance(value, str) else str(value)
    return shown if len(shown) <= _LONGEST_SHOWN else shown[:_LONGEST_SHOWN] + "…"
