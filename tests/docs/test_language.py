"""The field's terms: phrases that have one do not come back in docs, docstrings or messages."""

import re

import pytest
from helpers.problems import ROOT

# what is not to be written, and what is
PHRASES = {
    r"earn(s|ed|ing)?": "has a return of, returns more than",
    r"(doing|do-|does) ?nothing action|doing nothing|do-nothing": "the no-op",
    r"in vain": "redundant",
    r"done twice": "redundant",
    r"by a hair": "the figure",
    r"counts? for nothing|counted for nothing": "is ignored",
    r"laid over": "sharded across",
    r"taken up|tak(e|es|ing) (it )?up|took (it )?up": "restored, included",
    r"evens? out|evening out": "corrects",
    r"wak(e|es|ing|en|ens) (it|an? \w+|the \w+)|wake it": "restores the gradient of",
    r"taken as given|take as given": "treated as constant (stop-gradient)",
    r"loud(er|ly)?": "large",
    r"a match for": "level with",
    r"as much at each": "scaled per time step by",
    r"have (their|its) try|has its try": "is trained",
    r"worth anything": "has a reward",
}
FILES = [
    path
    for pattern in (
        "*.md",
        "docs/**/*.md",
        "mdpo_rddl/**/*.py",
        "mdpo_rddl/**/*.j2",
        "tools/*",
        "examples/**/*.*",
        "*.yml",
        "pyproject.toml",
    )
    for path in sorted(ROOT.glob(pattern))
    if path.is_file()
    and path.suffix in (".md", ".py", ".sh", ".rddl", ".j2", ".ipynb", ".yml", ".toml")
]


def found_in(text: str, phrase: str) -> list[str]:
    """The places of a phrase, also across the end of a line."""
    joined = re.sub(r"\s*\n\s*(# )?", " ", text)
    return [hit[0] for hit in re.finditer(rf"\b(?:{phrase})\b", joined, flags=re.IGNORECASE)]


@pytest.mark.parametrize("phrase", PHRASES)
def test_a_phrase_stays_out(phrase):
    hits = {
        str(path.relative_to(ROOT)): hits
        for path in FILES
        if (hits := found_in(path.read_text(encoding="utf-8"), phrase))
    }
    assert hits == {}, f"better: {PHRASES[phrase]}"


def test_a_phrase_is_seen_across_lines_and_not_inside_words():
    assert found_in("the policy earns\n  more", "earn(s|ed|ing)?") == ["earns"]
    assert found_in("all of it in\n    # vain", "in vain") == ["in vain"]
    assert found_in("what is learned", "earn(s|ed|ing)?") == []
    assert len(FILES) > 300
