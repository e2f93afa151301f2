"""What JaxPlan's loop carries from one iteration to the next, seen and put back from outside.

The loop keeps its state in local variables. All of it passes through the planner's compiled
functions, through the objects that average the test losses and through the stopping rule: these
are what is watched here, and what a resumed loop is given to begin with.
"""

import contextlib
import itertools
import threading
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import jax
import numpy as np

from mdpo_rddl.planner.planner import MDPOPlanner
from mdpo_rddl.planner.start import unit_hyperparams
from mdpo_rddl.planner.training.fitting import fitted, fitted_leaves
from mdpo_rddl.planner.training.pgpe_state import TREES as PGPE_TREES
from mdpo_rddl.planner.training.pgpe_state import WatchedPGPE
from mdpo_rddl.planner.update.restarts import AllLanes
from mdpo_rddl.planner.upstream import JaxPlannerStoppingRule, planner

Tensors = dict[str, np.ndarray]

_TREES = ("params", "opt_state", "opt_aux", "model", "test_model")
_PREPROCESSOR, _BEST_LOSSES = "preprocessor", "pgpe/best_losses"
# JaxPlan's averages are made by name in the first turn of its loop
_FIRST_TURN = threading.Lock()


@dataclass(frozen=True)
class LoopState:
    """The state after an iteration.

    Attributes:
      tensors: the leaves of the trees by their names and numbers, the key, and the test losses
        that are averaged with their running sums.
      rule: the stopping rule's numbers.
    """

    tensors: Tensors
    rule: Mapping[str, float]


class WatchedLoop:
    """JaxPlan's loop of one planner, watched while its block is open.

    Attributes:
      progress: percent of the budget used after so many iterations, for a loop that goes on.
    """

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
        self._averages: list[Any] = []
        self._pgpe: WatchedPGPE | None = None
        self._iterations, self._is_tested = 0, False
        self.progress: Callable[[int], float] = lambda iterations: 0.0

    def arguments(self) -> dict[str, Any]:
        """Arguments of `optimize_generator` that make it go on, besides the key and the budget.

        Raises:
          KeyError, ValueError: if the state does not fit the planner.
        """
        given: dict[str, Any] = {} if self._rule is None else {"stopping_rule": self._rule}
        if self._resumed is None:
            return given
        model = self._planner.compiled.model_aux["params"]
        params = self._planner.params_structure(unit_hyperparams(self._planner))
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
            with self._averaging():
                first = next(generator, None)
            for callback in itertools.chain([] if first is None else [first], generator):
                if self._pgpe is not None:
                    self._pgpe.passed(self._averages[-1].latest)
                self._iterations += 1
                yield callback

    def state(self, callback: Mapping[str, Any]) -> Callable[[], LoopState]:
        """What to call, at any later time, for the state after the iteration of a callback."""
        carried = {**self._carried, "key": callback["key"]}
        preprocessor, trees = self._planner.preprocessor, list(_TREES)
        if preprocessor is not None:
            trees.append(_PREPROCESSOR)
            stats = callback["policy_hyperparams"][preprocessor.HYPERPARAMS_KEY]
            carried[_PREPROCESSOR] = stats
        if self._pgpe is not None:
            trees += PGPE_TREES
            carried[_BEST_LOSSES] = self._pgpe.best_losses
        losses = [(tuple(average._memory), average._total) for average in self._averages]
        rule = {} if self._rule is None else self._rule.numbers()

        def make() -> LoopState:
            names = [name for name in ("key", _BEST_LOSSES) if name in carried]
            tensors = {name: np.asarray(carried[name]) for name in names}
            for name, (memory, total) in zip(self._names_of_losses, losses, strict=True):
                tensors |= {name: np.stack(memory), f"{name}_sum": np.asarray(total)}
            for name in trees:
                for i, leaf in enumerate(jax.tree.leaves(carried[name])):
                    tensors[f"{name}/{i}"] = np.asarray(leaf)
            return LoopState(tensors, rule)

        return make

    @property
    def _names_of_losses(self) -> tuple[str, ...]:
        """Of JaxPlan's averages, in the order in which its loop makes them."""
        return ("pgpe/losses", "losses") if self._planner.use_pgpe else ("losses",)

    @contextlib.contextmanager
    def _watching(self) -> Iterator[None]:
        trained, carried = self._planner, self._carried
        plain_update, plain_test_loss = trained.update, trained.test_loss

        def update(*arguments: Any) -> Any:
            result = plain_update(*arguments)
            carried.update(params=result[0], opt_state=result[2], opt_aux=result[3])
            carried.update(train_loss=result[4], model=result[6])
            self._is_tested = False
            return result

        def test_loss(*arguments: Any) -> Any:
            arguments = (*arguments[:5], carried.get("test_model", arguments[5]), *arguments[6:])
            result = plain_test_loss(*arguments)
            if not self._is_tested:  # the loop keeps nothing of the test of PGPE's policies
                carried["test_model"], self._is_tested = result[1][1], True
            return result

        replaced: dict[str, Any] = {"update": update, "test_loss": test_loss}
        if trained.use_pgpe:
            self._pgpe = self._watched_pgpe()
            replaced.update(pgpe=self._pgpe, merge_pgpe=self._pgpe.merge)
        if self._resumed is not None:
            replaced.update(self._restored())
        plain = {name: getattr(trained, name) for name in replaced}
        had = {name: name in vars(trained) for name in replaced}
        for name, value in replaced.items():
            setattr(trained, name, value)
        try:
            yield
        finally:
            for name in replaced:
                if had[name]:
                    setattr(trained, name, plain[name])
                else:
                    delattr(trained, name)

    def _restored(self) -> dict[str, Any]:
        """What the loop begins with in a planner that goes on, by the planner's names."""
        trained = self._planner
        model = trained._broadcast_pytree(trained.test_compiled.model_aux["params"])
        self._carried["test_model"] = self._tree("test_model", model)
        plain = trained.init_optimizer

        def init_optimizer(params: Any) -> Any:
            opt_state, opt_aux = plain(params)
            return self._tree("opt_state", opt_state), self._tree("opt_aux", opt_aux)

        restored: dict[str, Any] = {"init_optimizer": init_optimizer}
        if (preprocessor := trained.preprocessor) is not None:
            real = trained.compiled.REAL
            first = jax.tree.map(lambda leaf: np.asarray(leaf, real), preprocessor.initialize())
            restored["preprocessor"] = _Restored(preprocessor, self._tree(_PREPROCESSOR, first))
        return restored

    def _watched_pgpe(self) -> WatchedPGPE:
        losses = None
        if self._resumed is not None:
            shape, real = (self._planner.parallel_updates,), self._planner.compiled.REAL
            losses = fitted(_BEST_LOSSES, self._resumed.tensors[_BEST_LOSSES], shape, real)
        progress = self.progress
        return WatchedPGPE(
            self._planner, self._carried, losses, self._tree, lambda: progress(self._iterations)
        )

    @contextlib.contextmanager
    def _averaging(self) -> Iterator[None]:
        """Has JaxPlan's loop in this thread average test losses with objects known here."""
        here = threading.get_ident()

        def make(window: int) -> Any:
            # the loop of another thread may begin meanwhile
            if threading.get_ident() != here:
                return made(window)
            average = _watched_average(made, window)
            if self._resumed is not None:
                name = self._names_of_losses[len(self._averages)]
                average._memory.extend(self._resumed.tensors[name])
                average._total = self._resumed.tensors[f"{name}_sum"]
            self._averages.append(average)
            return average

        with _FIRST_TURN:
            made = planner.RollingMean
            planner.RollingMean = make
            try:
                yield
            finally:
                planner.RollingMean = made

    def _check_losses(self) -> None:
        """Raises ValueError if the test losses are not one of each lane."""
        assert self._resumed is not None
        lanes, real = (self._planner.parallel_updates,), self._planner.compiled.REAL
        for name in self._names_of_losses:
            losses, total = (self._resumed.tensors[each] for each in (name, f"{name}_sum"))
            fitted(name, losses, (len(losses), *lanes), real)
            fitted(f"{name}_sum", total, lanes, real)

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


def _watched_average(made: Any, window: int) -> Any:
    """An average of JaxPlan's class that also knows its latest value."""

    class Average(made):
        latest: Any = None

        def update(self, losses: Any) -> Any:
            self.latest = super().update(losses)
            return self.latest

    return Average(window)


def _placed(leaf: Any, saved: np.ndarray) -> Any:
    """On the devices of the leaf that it stands for."""
    if isinstance(leaf, jax.Array) and leaf.shape == saved.shape:
        return jax.device_put(saved, leaf.sharding)
    return saved


class _Restored:
    """A preprocessor whose statistics are those that were left."""

    def __init__(self, preprocessor: Any, statistics: Any) -> None:
        self._preprocessor, self._statistics = preprocessor, statistics

    def initialize(self) -> Any:
        return self._statistics

    def __getattr__(self, name: str) -> Any:
        return getattr(self._preprocessor, name)


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
