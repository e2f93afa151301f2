"""The exact simulator, whose own errors are told from those of the policy that it plays."""

import contextlib
from collections.abc import Iterator, Mapping
from typing import Any

from pyRDDLGym.core.simulator import RDDLSimulator

from mdpo_rddl.errors import InputError, interrupt_behind, one_line_cause


class NotPlayedError(InputError):
    """The exact environment itself has failed: its model has no value for a state or an action."""


class PlayedSimulator(RDDLSimulator):
    """pyRDDLGym's simulator, of whose expressions any error is a `NotPlayedError`."""

    def reset(self) -> Any:
        """As pyRDDLGym's."""
        with _told():
            return super().reset()

    def step(self, actions: Mapping[str, Any]) -> Any:
        """As pyRDDLGym's."""
        with _told():
            return super().step(actions)

    def check_action_preconditions(self, actions: Mapping[str, Any], silent: bool = False) -> bool:
        """As pyRDDLGym's."""
        with _told():
            return bool(super().check_action_preconditions(actions, silent))

    def check_state_invariants(self, silent: bool = False) -> bool:
        """As pyRDDLGym's."""
        with _told():
            return bool(super().check_state_invariants(silent))


@contextlib.contextmanager
def _told() -> Iterator[None]:
    try:
        yield
    except Exception as error:  # its errors have no common base, and numpy has its own
        if (stop := interrupt_behind(error)) is not None:
            raise stop from None
        cause = f"{type(error).__name__}: {one_line_cause(error)}"
        raise NotPlayedError(f"the environment fails: {cause}") from error
