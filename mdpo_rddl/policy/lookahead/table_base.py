"""A table of actions as a policy that can be thought beyond."""

import copy
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from mdpo_rddl.machine.device import computing_on
from mdpo_rddl.planner.build import build_planner
from mdpo_rddl.planner.config.presets.auto import auto_preset
from mdpo_rddl.planner.device import fitting_device
from mdpo_rddl.planner.planner import MDPOPlanner
from mdpo_rddl.policy.lookahead.base import Tabled
from mdpo_rddl.policy.lookahead.table_lookup import TableLookup
from mdpo_rddl.problem.load import Problem


class TableBase:
    """What `Prepared` asks for, of a table: a planner for its models, the table for its actions."""

    def __init__(self, policy: Tabled) -> None:
        """Compiles the planner.

        Raises:
          InputError: if JaxPlan refuses the problem.
          ValueError: if the table is too large.
        """
        # decisions in unknown states are counted apart from those of the policy's own play
        self._table = copy.copy(policy)
        self._lookup = TableLookup(policy.table)
        config = auto_preset(policy.problem.domain_name).without_section("Search")
        with computing_on(fitting_device(policy.problem)):
            self._planner = build_planner(policy.problem, config).planner

    @property
    def problem(self) -> Problem:
        """What is played."""
        return self._table.problem

    @property
    def planner(self) -> MDPOPlanner:
        """Its models; its own policy plays nothing."""
        return self._planner

    @property
    def rollout_policy(self) -> Callable[..., Any]:
        """Looks up the table's actions."""
        return self._lookup.policy

    @property
    def params(self) -> Any:
        """The table's arrays."""
        return self._lookup.arrays

    @property
    def policy_hyperparams(self) -> Mapping[str, Any]:
        """None."""
        return {}

    @property
    def seed(self) -> int:
        """Of the run that found the table."""
        return self._table.seed

    @property
    def underlying(self) -> None:
        """None: the state is observed."""

    @property
    def vote(self) -> None:
        """None: the state is observed."""

    def __call__(self, step: int, observation: Mapping[str, Any]) -> Mapping[str, Any]:
        """The table's action at a step."""
        return self._table(step, observation)

    def is_unknown(self, state: Mapping[str, Any]) -> bool:
        """Whether a state, as the vectorized environment shows it, is not in the table."""
        return not self._table.knows(state)

    def save(self, path: str | Path) -> None:
        """Writes the table to a file."""
        self._table.save(path)
