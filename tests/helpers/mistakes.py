"""How tests read what is said about bad input."""

from collections.abc import Callable

import pytest

from mdpo_rddl.errors import InputError


def one_line(call: Callable[[], object]) -> str:
    """The message, which has no line break and no colour code."""
    with pytest.raises(InputError) as caught:
        call()
    message = str(caught.value)
    assert message.isprintable()
    return message
