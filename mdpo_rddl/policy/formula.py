"""A feedback policy's formula on numpy: for many states at once, or for one."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from mdpo_rddl.errors import InputError, printable
from mdpo_rddl.planner.config.config import PlannerConfig
from mdpo_rddl.planner.plans.feedback import Feedback, Params
from mdpo_rddl.planner.plans.feedback_actions import FeedbackActions, in_order
from mdpo_rddl.planner.plans.feedback_shape import FeedbackShape
from mdpo_rddl.policy.file import SavedPolicy
from mdpo_rddl.policy.legal import LegalActions
from mdpo_rddl.policy.trees import flatten
from mdpo_rddl.problem.boxes import action_boxes
from mdpo_rddl.problem.limits import group_limits
from mdpo_rddl.problem.load import Problem
from mdpo_rddl.problem.observation import as_numbers, is_observed
from mdpo_rddl.simulator.simulator import Simulator

Arrays = Mapping[str, np.ndarray]


def require_count(known: int, count: int, step: int) -> None:
    """Raises `InputError` unless as many episodes are played at a step as at the one before."""
    if known != count:
        raise InputError(
            f"there are {count} observations at step {step}, and {known} at the one before: "
            "a policy that remembers plays the same episodes from step 0 on"
        )


METHOD = "FeedbackPlan"
"""The name of these policies in a configuration."""


class FeedbackFormula:
    """The feedback policies of a configuration, as functions of their parameters.

    Attributes:
      simulator: of the problem.
      actions: on numpy, before anything is made legal.
    """

    def __init__(
        self, problem: Problem, config: PlannerConfig, simulator: Simulator | None = None
    ) -> None:
        """Finds the features and reads the preconditions.

        Args:
          problem: that is played.
          config: with a `FeedbackPlan`.
          simulator: of the problem; made here if None.

        Raises:
          InputError: if the configuration does not fit the problem, or the simulator does not know
            an expression of it.
        """
        self.simulator = simulator = Simulator(problem) if simulator is None else simulator
        model, arguments = problem.model, config.policy_arguments
        units = arguments.pop("units", None) or {}
        try:
            shape = FeedbackShape(**arguments)
            feedback = Feedback(model, simulator.values, shape, problem.horizon, np.float32)
        except (TypeError, ValueError) as error:
            raise InputError(f"{config.source}: [Planner] method_kwargs: {error}") from error
        bounds = action_boxes(model)
        for name, kind in model.variable_ranges.items():
            if name in bounds and kind in model.type_to_objects:
                last = len(model.type_to_objects[kind]) - 1.0
                bounds[name] = tuple(np.full(simulator.shapes[name], end) for end in (0.0, last))
        kinds = np.float32, np.int32
        self.actions = FeedbackActions.of(feedback, model, simulator.values, units, bounds, kinds)
        keeps = config.section("MDPO").get("keep_group_limits", True)
        self._groups = group_limits(model)[0] if keeps else []
        concurrency = self.actions.limits
        if any(np.any(self.actions.noop[n]) for limit in concurrency for n in limit.groups):
            concurrency = ()
        legal = LegalActions(simulator, [*self._groups, *concurrency]) if keeps else None
        self._legal = legal if legal is not None and legal.is_needed else None
        self._model, self._bounds = model, bounds
        self._hidden = set(model.observ_fluents)
        self._initial, self._shapes = simulator.values, simulator.shapes

    @property
    def is_checked(self) -> bool:
        """Whether proposals may be illegal, and another action is played then."""
        return self._legal is not None

    def replicas(self, params: Params) -> "FormulaReplicas":
        """What decides for B episodes at once.

        Args:
          params: of one policy; or of one for each episode, with a last axis B.
        """
        return FormulaReplicas(self, params)

    def play(self, params: Params, state: Arrays, step: int) -> dict[str, np.ndarray]:
        """The actions of states, per action fluent [*shape, B].

        Args:
          params: see `replicas`.
          state: per observed fluent [*shape, B], and the entries of the memory.
          step: of the rollout, from 0.
        """
        with np.errstate(all="ignore"):  # as under JAX
            proposal = self._in_box(self.actions.played(params, state, step, self._groups))
            if self._legal is None:
                return proposal
            memory = self.actions.feedback.empty_memory()
            known = {name: value for name, value in state.items() if name not in memory}

            def preferences() -> Arrays:
                likely = self.actions.probabilities(params, state, step, in_order)
                return {name: likely[name] for name in self.actions.bools}

            return self._legal(proposal, preferences, known)

    def _in_box(self, actions: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Reals in 64 bit, clipped to their box: one rounded to 32 bit can lie outside."""
        clipped = {}
        for name, value in actions.items():
            if self._model.variable_ranges[name] == "real":
                lower, upper = (each[..., np.newaxis] for each in self._bounds[name])
                clipped[name] = np.clip(np.asarray(value, np.float64), lower, upper)
        return {**actions, **clipped}

    def seen(self, step: int, observations: Mapping[str, Any]) -> dict[str, np.ndarray]:
        """What an environment shows of several episodes, as numbers [*shape, count].

        Before the first step of a partially observed problem it shows nothing: the initial values
        stand for that.

        Args:
          step: number of decisions before.
          observations: per fluent [count, *shape].
        """
        found = {}
        for name in self.actions.feedback.observed:
            values, shape = observations[name], self._shapes[name]
            if step == 0 and name in self._hidden and not is_observed(values):
                values = np.broadcast_to(self._initial[name], (len(values), *shape))
            numbers = as_numbers(self._model, name, values)
            found[name] = np.moveaxis(np.reshape(numbers, (len(numbers), *shape)), 0, -1)
        return found

    def played(self, actions: Mapping[str, Any]) -> dict[str, np.ndarray]:
        """Actions of an environment as numbers, per action fluent [*shape, count].

        Args:
          actions: per action fluent [count, *shape].
        """
        return {
            name: np.moveaxis(
                np.reshape(as_numbers(self._model, name, value), (len(value), *self._shapes[name])),
                0,
                -1,
            )
            for name, value in actions.items()
        }

    def shown(self, actions: Arrays) -> dict[str, np.ndarray]:
        """Actions as an environment takes them [count, *shape].

        Reals are clipped to their box in 64 bit, where one rounded to 32 bit can lie outside; what
        is no number is the default, which the environment would play. Objects go by their names.

        Args:
          actions: per action fluent [*shape, count].
        """
        found = {}
        for name, value in actions.items():
            kind, value = self._model.variable_ranges[name], np.moveaxis(value, -1, 0)
            if kind == "real":
                value = np.asarray(value, np.float64)
                value = np.where(np.isnan(value), self._initial[name], value)
                value = np.clip(value, *self._bounds[name])
            elif kind in self._model.type_to_objects:
                value = self._model.index_to_object_string_array(kind, value)
            found[name] = value
        return found


def without_idle(params: Params) -> Params:
    """The parameters without those parts that have no effect; the others play the same."""
    kept = {"shared": params["shared"]} if "shared" in params else {}
    kept["own"] = {
        name: {entry: v for entry, v in entries.items() if entry == "bias" or np.any(v)}
        for name, entries in params["own"].items()
    }
    if any(np.any(each) for each in params.get("plan", {}).values()):
        kept["plan"] = params["plan"]
    if any(np.any(each["output"]) for each in params.get("lifted", {}).values()):
        kept["lifted"] = params["lifted"]
    net = params.get("net", {})
    if any(np.any(each) for name, each in net.items() if name.startswith("output_")):
        kept["net"] = net
    return kept


class FormulaPlay:
    """A policy of a formula as environments play it: step by step, one episode or several.

    The memory is empty at step 0, and at a step that does not follow the last. A step that is
    asked for again is the same decision again.
    """

    def __init__(self, formula: FeedbackFormula, params: Params) -> None:
        """Remembers nothing yet."""
        self._formula, self._params = formula, without_idle(params)
        self._one, self._many = (_Episodes(formula) for _ in range(2))

    def __call__(self, step: int, state: Mapping[str, Any]) -> dict[str, np.ndarray]:
        """The action per fluent [*shape] at a step, for an observation per fluent."""
        each = {name: np.asarray(value)[np.newaxis] for name, value in state.items()}
        actions = self._one.decide(step, each, self._params)
        return {name: value[0] for name, value in actions.items()}

    def was_played(self, actions: Mapping[str, Any]) -> None:
        """Takes in what was played at the latest step, per action fluent [*shape]."""
        self._one.note({name: np.asarray(value)[np.newaxis] for name, value in actions.items()})

    def batch(self, step: int, observations: Mapping[str, Any]) -> dict[str, np.ndarray]:
        """The actions for the observations of several episodes at one step, in one call.

        Args:
          step: number of decisions before.
          observations: per fluent its values [batch, *shape].

        Raises:
          InputError: if a policy that remembers is given another number than at the step before.
        """
        return self._many.decide(step, observations, self._params)

    def were_played(self, actions: Mapping[str, np.ndarray]) -> None:
        """Takes in what was played at the latest step of `batch`, per fluent [batch, *shape]."""
        self._many.note(actions)

    def memory_at(self, step: int) -> dict[str, np.ndarray]:
        """What is remembered when a step's action is chosen, per entry [*shape]."""
        return {name: value[..., 0] for name, value in self._one.before(step, 1).items()}

    def reset(self) -> None:
        """Forgets the episodes."""
        self._one, self._many = (_Episodes(self._formula) for _ in range(2))


class _Episodes:
    """Some episodes that are played side by side, all at the same step."""

    def __init__(self, formula: FeedbackFormula) -> None:
        self._formula, self._step = formula, -1
        self._before: dict[str, Any] = {}
        self._after: dict[str, Any] = {}
        self._seen: dict[str, np.ndarray] = {}

    def decide(
        self, step: int, observations: Mapping[str, Any], params: Params
    ) -> dict[str, np.ndarray]:
        """The actions [count, *shape], which count as played unless `note` says otherwise."""
        formula = self._formula
        self._seen = formula.seen(step, observations)
        count = next(iter(self._seen.values())).shape[-1] if self._seen else 1
        memory = self.before(step, count)
        actions = formula.play(params, {**self._seen, **memory}, step)
        self._remember(actions)
        return formula.shown(actions)

    def before(self, step: int, count: int) -> dict[str, Any]:
        """The memories before a step's decision, per entry [*shape, count].

        Raises:
          InputError: if the step follows the last one, which was of another number of episodes.
        """
        if step > 0 and step == self._step + 1:
            self._before = self._after
        elif step == 0 or step != self._step:
            self._before = {
                name: np.broadcast_to(value[..., np.newaxis], (*value.shape, count))
                for name, value in self._formula.actions.feedback.empty_memory().items()
            }
        for value in self._before.values():
            require_count(value.shape[-1], count, step)
        self._step = step
        return self._before

    def note(self, actions: Mapping[str, Any]) -> None:
        """Takes in what was played instead, per action fluent [count, *shape]."""
        if self._before:
            self._remember(self._formula.played(actions))

    def _remember(self, actions: Arrays) -> None:
        if self._before:
            given = self._before, self._step, self._seen, actions
            self._after = self._formula.actions.remembered(*given)


class FormulaReplicas:
    """A feedback policy for B episodes at once.

    Attributes:
      memory: before the latest step, per entry [*shape, B].
    """

    def __init__(self, formula: FeedbackFormula, params: Params) -> None:
        """Remembers nothing yet."""
        self._formula, self._params = formula, without_idle(params)
        self._step = 0
        self.memory: dict[str, Any] = {}
        self._seen: Arrays = {}

    def __call__(self, step: int, observation: Arrays) -> dict[str, np.ndarray]:
        """Per action fluent [*shape, B]."""
        if step == 0:
            count = next(iter(observation.values())).shape[-1]
            self.memory = {
                name: np.broadcast_to(value[..., np.newaxis], (*value.shape, count))
                for name, value in self._formula.actions.feedback.empty_memory().items()
            }
        self._step, self._seen = step, dict(observation)
        return self._formula.play(self._params, {**observation, **self.memory}, step)

    def were_played(self, actions: Arrays) -> None:
        """Brings the memory up to date."""
        if self.memory:
            given = self.memory, self._step, self._seen, actions
            self.memory = self._formula.actions.remembered(*given)


def require_formula_params(saved: SavedPolicy, formula: FeedbackFormula, source: str) -> None:
    """Raises `InputError` unless a saved policy's parameters are those of a formula's.

    Args:
      saved: the policy.
      formula: of its problem and configuration.
      source: where the policy came from, for the message.
    """
    trees = saved.params, saved.policy_hyperparams
    if not all(isinstance(tree, Mapping) for tree in trees):
        raise InputError(f"{source}: damaged policy file: it has no trees of tensors")
    for name, value in saved.policy_hyperparams.items():
        if np.shape(value) or np.asarray(value).dtype.kind not in "fiu":
            raise InputError(
                f"{source}: damaged policy file: its hyperparameter {printable(name)} is not the "
                "planner's"
            )
    initial = formula.actions.feedback.initial(np.random.default_rng(0))
    wanted, found = (flatten(tree, "params") for tree in (initial, saved.params))
    shapes = [{n: leaf.shape for n, leaf in tree.items()} for tree in (wanted, found)]
    if shapes[0] != shapes[1]:
        raise InputError(
            f"{source}: damaged policy file, or saved for another horizon: its tensors are "
            f"{shapes[1]}, expected {shapes[0]}"
        )
    if kinds := {str(leaf.dtype) for leaf in found.values() if leaf.dtype != np.float32}:
        names = ", ".join(sorted(kinds))
        raise InputError(
            f"{source}: damaged policy file: its parameters are {names}, not as the planner's"
        )
    if not all(np.all(np.isfinite(leaf)) for leaf in found.values()):
        raise InputError(f"{source}: damaged policy file: it holds numbers that are not finite")
