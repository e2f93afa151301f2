"""The blocks of an RDDL file as they stand in it, and which of them pyRDDLGym ignores.

Its grammar takes more than its model reads, and of two blocks of one name it keeps the last one.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

_KINDS = ("domain", "non-fluents", "instance", "policy")
_SECTIONS = (
    "domain",
    "requirements",
    "types",
    "pvariables",
    "cpfs",
    "cdfs",
    "reward",
    "termination",
    "action-preconditions",
    "state-action-constraints",
    "state-invariants",
    "non-fluents",
    "objects",
    "init-state",
    "max-nondef-actions",
    "horizon",
    "discount",
)
_UNREAD = "state-action-constraints"
_TO_BE_ADDED = {
    "pvariables": "pvariables { NAME : { state-fluent, real, default = 0.0 }; };",
    "cpfs": "cpfs { NAME' = NAME; };",
    "reward": "reward = 0.0;",
    "objects": "objects { TYPE : {NAME}; };",
    "domain": "domain = NAME;",
    "horizon": "horizon = 40;",
    "discount": "discount = 1.0;",
}


@dataclass
class Section:
    """What stands inside a block: `cpfs { ... };`, `horizon = 40;`.

    Attributes:
      name: its keyword; "non-fluents =" where an instance names its non-fluents.
      line: of the keyword.
      is_empty: whether there is nothing between its braces.
    """

    name: str
    line: int
    is_empty: bool = False


@dataclass
class Block:
    """A block of a file.

    Attributes:
      path: of the file.
      kind: "domain", "non-fluents", "instance" or "policy".
      name: what it is called.
      line: where it begins.
      sections: in their order.
    """

    path: Path
    kind: str
    name: str
    line: int
    sections: list[Section] = field(default_factory=list)

    @property
    def place(self) -> str:
        """File and line."""
        return f"{self.path}:{self.line}"

    def has(self, name: str) -> bool:
        """Whether there is such a section."""
        return any(section.name == name for section in self.sections)


class Outline:
    """Finds the blocks while the tokens of a file pass by."""

    def __init__(self, path: Path) -> None:
        """Has seen nothing.

        Args:
          path: of the file.
        """
        self.blocks: list[Block] = []
        self._path, self._depth = path, 0
        self._last: Any = None

    def take(self, token: Any) -> None:
        """Takes in the next token of ply's."""
        last, self._last = self._last, token
        word = None if last is None else last.value
        if token.type == "LCURLY":
            self._depth += 1
        elif token.type == "RCURLY":
            if self._depth == 2 and word == "{" and self._sections:
                self._sections[-1].is_empty = True
            self._depth -= 1
        elif self._depth == 0 and word in _KINDS:
            self.blocks.append(Block(self._path, word, str(token.value), last.lineno))
        elif self._depth == 1 and token.value in _SECTIONS and self.blocks:
            name = "cpfs" if token.value == "cdfs" else token.value
            self._sections.append(Section(name, token.lineno))
        elif self._depth == 1 and word == "non-fluents" and token.value == "=" and self._sections:
            self._sections[-1].name = "non-fluents ="

    @property
    def _sections(self) -> list[Section]:
        return self.blocks[-1].sections if self.blocks else []


def ignored(blocks: Sequence[Block], counting: Sequence[Block]) -> Iterator[str]:
    """What stands in the files and has no effect, each with what to do about it.

    Args:
      blocks: of all files.
      counting: those that make the problem: a domain, non-fluents, an instance.
    """
    for block in blocks:
        if block.kind == "policy":
            yield f"{block.place}: the policy block {block.name} is ignored: a policy is looked for"
        elif all(block is not one for one in counting):
            yield _beside(block, counting)
    for block in counting:
        yield from _ignored_sections(block)


def _beside(block: Block, counting: Sequence[Block]) -> str:
    """That another block counts."""
    what = f"{block.place}: the {block.kind} block {block.name} is ignored"
    for one in counting:
        if one.kind == block.kind:
            named = next((each for each in counting if each.kind == "instance"), None)
            why = ""
            if one.kind == "non-fluents" and named is not None and one.name != block.name:
                why = f", which instance {named.name} is for"
            return f"{what}: {one.name} counts{why} ({one.place})"
    return f"{what}: those in the instance block count"


def _ignored_sections(block: Block) -> Iterator[str]:
    within = f"of {block.kind} {block.name}"
    for place, section in enumerate(block.sections):
        at = f"{block.path}:{section.line}"
        later = [each for each in block.sections[place + 1 :] if each.name == section.name]
        if section.is_empty:
            continue
        if section.name == _UNREAD:
            yield (
                f"{at}: the block {_UNREAD} {within} is ignored, as pyRDDLGym does: limits of "
                "actions belong in action-preconditions, limits of states in state-invariants"
            )
        elif later:
            yield (
                f"{at}: {section.name.removesuffix(' =')} {within} is ignored: it is there again "
                f"in line {later[-1].line}, and the last one counts; make them one"
            )
        elif (
            section.name == "objects" and block.kind == "instance" and not block.has("non-fluents")
        ):
            yield (
                f"{at}: the objects {within} are ignored, since it has no non-fluents block of its "
                "own: objects belong in the non-fluents block"
            )


def to_add(section: str) -> str:
    """What to add where a section is missing, as the end of a sentence."""
    return f": add `{_TO_BE_ADDED[section]}`" if section in _TO_BE_ADDED else ""
