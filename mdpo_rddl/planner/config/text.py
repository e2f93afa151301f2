"""The text of a `.cfg` file: its sections, and the line of what is wrong in it."""

import ast
import configparser
import re
import warnings
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from mdpo_rddl.errors import InputError
from mdpo_rddl.planner.config.search_section import SEARCH

JAXPLAN_SECTIONS = ("Compiler", "Planner", "Optimize")
SECTIONS = (*JAXPLAN_SECTIONS, "Noise", "MDPO", SEARCH)
"""All that a configuration may have, in the order in which they are written."""
DEFAULT_COMPILER = "DefaultJaxRDDLCompilerWithGrad"


def parse_sections(text: str, source: str) -> dict[str, dict[str, Any]]:
    """Per section, its keys and literal values, as JaxPlan reads them.

    Raises:
      InputError: naming source, line, section and key as far as they are known, if the text
        has no such form, or a value is not a literal or holds a number that is not finite.
    """
    parser = configparser.RawConfigParser()
    parser.optionxform = str  # type: ignore[assignment,method-assign]  # keys keep their case
    try:
        parser.read_string(text)
    except configparser.Error as error:
        raise _syntax_error(source, error) from error
    return {
        section: {
            key: _literal(value, text, source, section, key) for key, value in parser.items(section)
        }
        for section in parser.sections()
    }


def format_sections(sections: Mapping[str, Mapping[str, Any]], names: Iterable[str]) -> str:
    """The text of those sections, in the order of their names; `parse_sections` reads it back."""
    blocks = []
    for name in names:
        if name in sections:
            lines = [f"{key}={value!r}" for key, value in sections[name].items()]
            blocks.append("\n".join([f"[{name}]", *lines]))
    return "\n\n".join(blocks) + "\n"


def one_line(error: Exception) -> str:
    """An error's message on one line."""
    return " ".join(str(error).split()) or type(error).__name__


def _literal(value: str, text: str, source: str, section: str, key: str) -> Any:
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of what is nearly a literal
            literal = ast.literal_eval(value)
    except (ValueError, SyntaxError, TypeError, MemoryError, RecursionError) as error:
        start = re.escape(value.partition("\n")[0])
        line_of_it = rf"^[ \t]*{re.escape(key)}[ \t]*[=:][ \t]*{start}[ \t]*$"
        found = re.search(line_of_it, text, flags=re.MULTILINE)
        line = "" if found is None else ":" + str(text.count("\n", 0, found.end()) + 1)
        raise InputError(
            f"{source}{line}: [{section}] {key}: {value!r} is not a Python literal "
            "(is a quote missing?)"
        ) from error
    if not _is_finite(literal):
        raise InputError(f"{source}: [{section}] {key}: must be finite, got {literal}")
    return literal


def _is_finite(literal: Any) -> bool:
    if isinstance(literal, dict):
        return all(map(_is_finite, [*literal.keys(), *literal.values()]))
    if isinstance(literal, list | tuple | set):
        return all(map(_is_finite, literal))
    try:
        return not isinstance(literal, int | float) or bool(np.isfinite(float(literal)))
    except OverflowError:
        return False


def _syntax_error(source: str, error: configparser.Error) -> InputError:
    line = getattr(error, "lineno", None)
    if isinstance(error, configparser.DuplicateOptionError):
        cause = f"[{error.section}] {error.option}: given twice"
    elif isinstance(error, configparser.DuplicateSectionError):
        cause = f"section [{error.section}] begins twice"
    elif isinstance(error, configparser.MissingSectionHeaderError):
        cause = "no section header, such as [Planner], comes before this line"
    elif isinstance(error, configparser.ParsingError) and error.errors:
        line, cause = error.errors[0][0], "neither a section header nor key=value"
    else:
        cause = one_line(error)
    return InputError(f"{source}{'' if line is None else f':{line}'}: {cause}")
