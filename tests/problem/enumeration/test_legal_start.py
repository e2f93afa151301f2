"""An initial state in which no action is legal is an error, which names what stands in the way."""

import pytest
from helpers.toys import problem_from, toy, toy_text

from mdpo_rddl.errors import InputError
from mdpo_rddl.problem.enumeration.model import require_legal_start

PIT = {"RISK": "1.0", "REST": "0.0", "FALLEN": "false", "DISCOUNT": "1.0"}
CISTERN = {"KIND_OF_WATER": "int", "KIND_OF_BUY": "int", "KIND_OF_DRAW": "int", "START": "0"}
REAL = {"KIND_OF_WATER": "real", "KIND_OF_BUY": "real", "KIND_OF_DRAW": "real", "START": "0.5"}


def refusal(problem):
    with pytest.raises(InputError) as raised:
        require_legal_start(problem)
    return str(raised.value)


def test_a_rule_that_reads_no_action():
    told = refusal(toy("pit", **PIT | {"FALLEN": "true"}))
    assert told.endswith(
        "i.rddl: no action is legal in the initial state, by the precondition ~fallen"
    )


@pytest.mark.parametrize("kind", ["int", "real"])
def test_all_actions_are_tried_where_they_are_discrete(kind):
    words = CISTERN | {"KIND_OF_WATER": kind}
    assert refusal(toy("cistern", **words)).endswith("by the precondition draw <= water")
    require_legal_start(toy("cistern", **words | {"START": "1"}))


def test_an_action_far_from_the_no_op_is_found():
    # neither single changes of the no-op nor all of a fluent's bools are legal
    text = toy_text("cistern", **CISTERN | {"START": "4"})
    require_legal_start(problem_from(text.replace("draw >= 1;", "draw >= 1; draw == 2; buy == 2;")))
    with pytest.raises(InputError, match="no action is legal"):
        require_legal_start(
            problem_from(
                text.replace("draw >= 1;", "draw >= 1; draw == 2; buy == 2; buy + draw <= 3;")
            )
        )


def test_what_is_not_decided_is_no_error():
    require_legal_start(toy("cistern", **REAL))


def test_a_rule_on_the_state_is_decided_beside_real_actions():
    text = toy_text("cistern", **REAL).replace("draw >= 1;", "draw >= 0; water >= 1;")
    assert refusal(problem_from(text)).endswith("by the precondition water >= 1")
