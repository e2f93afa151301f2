"""What JaxPlan's loop carries from one iteration to the next, seen and put back from outside.

The loop keeps its state in local variables. All of it passes through the planner's compiled
functions, through the objects that average the test losses and through the stopping rule: these
are what is watched here, and what a resumed loop is given to begin with.
"""

import contextlib
import threading
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import jax
import numpy as np

from mdpo_rddl.planner.fitting import fitted, fitted_leaves
from mdpo_rddl.planner.planner import MDPOPlanner
from mdpo_rddl.planner.update.restarts import AllLanes
from mdpo_rddl.planner.upstream import JaxPlannerStoppingRule, planner

Tensors = dict[str, np.ndarray]

_TREES = ("params", "opt_state", "opt_aux", "model", "test_model")
# JaxPlan's averages are made by name in the first turn of its loop
_FIRST_TURN = threading.Lock()


@dataclass(frozen=True)
class LoopState:
    """The state after an iteration.

    Attributes:
      tensors: the leaves of the trees by their names and numbers, the key, and the test losses
        that are averaged with their running sum.
      rule: the stopping rule's numbers.
    """

    tensors: Tensors
    rule: Mapping[str, float]


def can_be_resumed(trained: MDPOPlanner) -> bool:
    """Whether all of a planner's state is seen: not that of a second optimiser's."""
    return not trained.use_pgpe and trained.preprocessor is None and trained.dashboard is None


class WatchedLoop:
    """JaxPlan's loop of one planner, watched while its block is open."""

    def __init__(
        self,
        trained: MDPOPlanner,
        rule: JaxPlannerStoppingRule | None,
        resumed: LoopState | None = None,
    ) -> None:
        """Prepares to watch.

        Args:
          trained: the planner.
          rule: where the loop stops, if one was given.
          resumed: the state that the loop goes on with; it begins anew if None.
        """
        self._planner, self._resumed = trained, resumed
        self._rule = None if rule is None else _WatchedRule(rule, resumed)
        self._carried: dict[str, Any] = {}
        self._average: Any = None

    def arguments(self) -> dict[str, Any]:
        """Arguments of `optimize_generator` that make it go on, besides the key and the budget.

        Raises:
          KeyError, ValueError: if the state does not fit the planner.
        """
        given: dict[str, Any] = {} if self._rule is None else {"stopping_rule": self._rule}
        if self._resumed is None:
            return given
        model = self._planner.compiled.model_aux["params"]
        params = self._planner.params_structure(
            dict.fromkeys(self._planner.rddl.action_fluents, 1.0)
        )
        self._check_losses()
        lanes = self._planner.parallel_updates
        return {
            **given,
            "guess": AllLanes(self._tree("params", params, lanes)),
            "model_params": AllLanes(self._tree("model", model, lanes)),
        }

    @property
    def key(self) -> Any:
        """The key to go on with."""
        assert self._resumed is not None
        return fitted("key", self._resumed.tensors["key"], (2,), np.uint32)

    def turns(self, start: Callable[[], Iterator[dict[str, Any]]]) -> Iterator[dict[str, Any]]:
        """The callbacks of the loop.

        Args:
          start: makes JaxPlan's generator, with `arguments`.
        """
        with self._watching():
            generator = start()
            with self._averages():
                first = next(generator, None)
            if first is not None:
                yield first
                yield from generator

    def state(self, callback: Mapping[str, Any]) -> Callable[[], LoopState]:
        """What to call, at any later time, for the state after the iteration of a callback."""
        carried = {**self._carried, "key": callback["key"]}
        memory, total = tuple(self._average._memory), self._average._total
        rule = {} if self._rule is None else self._rule.numbers()

        def make() -> LoopState:
            tensors = {"key": np.asarray(carried["key"])}
            for name in _TREES:
                for i, leaf in enumerate(jax.tree.leaves(carried[name])):
                    tensors[f"{name}/{i}"] = np.asarray(leaf)
            tensors["losses"] = np.stack(memory)
            tensors["losses_sum"] = np.asarray(total)
            return LoopState(tensors, rule)

        return make

    @contextlib.contextmanager
    def _watching(self) -> Iterator[None]:
        trained = self._planner
        names = ("update", "test_loss", "init_optimizer")
        plain = {name: getattr(trained, name) for name in names}
        had = {name: name in vars(trained) for name in names}
        carried = self._carried
        if self._resumed is not None:
            model = trained._broadcast_pytree(trained.test_compiled.model_aux["params"])
            carried["test_model"] = self._tree("test_model", model)

        def update(*arguments: Any) -> Any:
            result = plain["update"](*arguments)
            carried.update(params=result[0], opt_state=result[2], opt_aux=result[3])
            carried["model"] = result[6]
            return result

        def test_loss(*arguments: Any) -> Any:
            arguments = (*arguments[:5], carried.get("test_model", arguments[5]), *arguments[6:])
            result = plain["test_loss"](*arguments)
            carried["test_model"] = result[1][1]
            return result

        def init_optimizer(params: Any) -> Any:
            opt_state, opt_aux = plain["init_optimizer"](params)
            return self._tree("opt_state", opt_state), self._tree("opt_aux", opt_aux)

        trained.update, trained.test_loss = update, test_loss
        if self._resumed is not None:
            trained.init_optimizer = init_optimizer
        try:
            yield
        finally:
            for name in names:
                if had[name]:
                    setattr(trained, name, plain[name])

    @contextlib.contextmanager
    def _averages(self) -> Iterator[None]:
        """Has JaxPlan's loop average test losses with an object that is known here."""
        made = planner.RollingMean

        def make(window: int) -> Any:
            self._average = average = made(window)
            if self._resumed is not None:
                tensors = self._resumed.tensors
                average._memory.extend(tensors["losses"])
                average._total = tensors["losses_sum"]
            return average

        with _FIRST_TURN:
            planner.RollingMean = make
            try:
                yield
            finally:
                planner.RollingMean = made

    def _check_losses(self) -> None:
        """Raises ValueError if the test losses are not one of each lane."""
        assert self._resumed is not None
        tensors = self._resumed.tensors
        losses, total = tensors["losses"], tensors["losses_sum"]
        lanes = (self._planner.parallel_updates,)
        fitted("losses", losses, (len(losses), *lanes), self._planner.compiled.REAL)
        fitted("losses_sum", total, lanes, self._planner.compiled.REAL)

    def _tree(self, name: str, template: Any, lanes: int | None = None) -> Any:
        """A saved tree, of the structure and on the devices of another one.

        Args:
          name: of the tree.
          template: that other one.
          lanes: length of the leading axis, if the template's leaves lack it.

        Raises:
          KeyError, ValueError: if it does not fit.
        """
        assert self._resumed is not None
        saved = fitted_leaves(name, self._resumed.tensors, template, lanes)
        leaves, structure = jax.tree.flatten(template)
        return jax.tree.unflatten(structure, list(map(_placed, leaves, saved)))


def _placed(leaf: Any, saved: np.ndarray) -> Any:
    """On the devices of the leaf that it stands for."""
    if isinstance(leaf, jax.Array) and leaf.shape == saved.shape:
        return jax.device_put(saved, leaf.sharding)
    return saved


class _WatchedRule(JaxPlannerStoppingRule):
    """A stopping rule whose numbers can be read, and put back when the loop resets it."""

    def __init__(self, rule: JaxPlannerStoppingRule, resumed: LoopState | None) -> None:
        self._rule = rule
        self._numbers = {} if resumed is None else dict(resumed.rule)

    def reset(self) -> None:
        self._rule.reset()
        numbers = dict(self._numbers)
        best = numbers.pop("callback", None)
        vars(self._rule).update({name: int(value) for name, value in numbers.items()})
        if best is not None:
            vars(self._rule)["callback"] = {"best_return": best}

    def monitor(self, callback: dict[str, Any]) -> bool:
        before = self._numbers.get("callback")
        if before is not None:  # the loop knows nothing of what was before it
            callback = {**callback, "best_return": max(callback["best_return"], before)}
        return bool(self._rule.monitor(callback))

    def numbers(self) -> dict[str, float]:
        found = {}
        for name, value in vars(self._rule).items():
            if name == "callback":
                found[name] = None if value is None else float(value["best_return"])
            elif isinstance(value, int):
                found[name] = value
        return {name: value for name, value in found.items() if value is not None}
