"""A policy with all that belongs to it: the problem, the configuration and the compiled planner."""

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from mdpo_rddl.errors import InputError
from mdpo_rddl.machine.html import html_table
from mdpo_rddl.planner.config.config import PlannerConfig
from mdpo_rddl.policy.agent import PolicyAgent
from mdpo_rddl.policy.belief import BeliefPlay, BeliefReplicas, gaining, voting, worth_most
from mdpo_rddl.policy.file import (
    AnySaved,
    SavedPlanRule,
    SavedPolicy,
    SavedTable,
    problem_identity,
    problem_played,
    require_same_problem,
    save_policy,
)
from mdpo_rddl.policy.formula import METHOD, FeedbackFormula, FormulaPlay, require_formula_params
from mdpo_rddl.policy.greedy import METHOD as GREEDY_METHOD
from mdpo_rddl.policy.greedy import GreedyFormula
from mdpo_rddl.policy.relaxed_plan_policy import RelaxedPlanPolicy
from mdpo_rddl.policy.side_by_side import BatchReplicas
from mdpo_rddl.policy.table_policy import TablePolicy
from mdpo_rddl.policy.trees import flatten
from mdpo_rddl.problem.grounding import (
    grounded,
    is_grounded,
    lifted,
    require_batch,
    require_observation,
    require_step,
)
from mdpo_rddl.problem.load import Problem
from mdpo_rddl.problem.source import ProblemSource
from mdpo_rddl.problem.underlying import underlying_mdp
from mdpo_rddl.simulator.evaluation import Replicated

if TYPE_CHECKING:  # who plays a feedback policy need not import JAX
    from mdpo_rddl.planner.planner import MDPOPlanner
    from mdpo_rddl.policy.action_voting import ActionVoting
    from mdpo_rddl.policy.lookahead.base import Vote
    from mdpo_rddl.policy.rule.explanation import Explanation

# properties that are computed once, and hang on nothing but what is played
_COMPILED = ("_play", "_voting", "underlying")


class Compiled:
    """What plays the policies of one problem and configuration, made when it is first asked for."""

    def __init__(
        self,
        planner: "MDPOPlanner | None" = None,
        formula: FeedbackFormula | None = None,
        greedy: GreedyFormula | None = None,
    ) -> None:
        """Takes what is there already."""
        self._planner, self._formula, self._greedy = planner, formula, greedy

    def planner(self, problem: Problem, config: PlannerConfig) -> "MDPOPlanner":
        """The compiled planner."""
        from mdpo_rddl.machine.device import computing_on
        from mdpo_rddl.planner.build import build_planner
        from mdpo_rddl.planner.device import fitting_device

        if self._planner is None:
            with computing_on(fitting_device(problem)):
                self._planner = build_planner(problem, config).planner
        return self._planner

    def formula(self, problem: Problem, config: PlannerConfig) -> FeedbackFormula | None:
        """The formula on numpy; None unless the configuration is one of feedback policies."""
        if self._formula is None and config.policy_method == METHOD:
            self._formula = FeedbackFormula(problem, config)
        return self._formula

    def greedy(self, problem: Problem, config: PlannerConfig) -> GreedyFormula | None:
        """The greedy policies' formula; None unless the configuration is one of them."""
        if self._greedy is None and config.policy_method == GREEDY_METHOD:
            self._greedy = GreedyFormula(problem, config)
        return self._greedy


@dataclass(frozen=True, eq=False)
class Policy(PolicyAgent):
    """A policy of one problem that can be played and saved; an agent of pyRDDLGym's.

    Attributes:
      problem: the parsed problem.
      config: the planner's configuration.
      params: parameters of one policy, a tree of arrays.
      policy_hyperparams: JaxPlan's policy hyperparameters that go with them.
      seed: of the run that found it, and of a policy that draws random numbers.
      candidates: what planning judged on the way, in its order: `seconds` since it began, `arm`,
        `candidate` (a label), `mean_return` and `error` on the exact model, `became_incumbent`.
        One that was loaded does not know the seconds.
      saved_underlying: a policy of the underlying MDP, with which it votes or thinks where the
        state is observed in part only; None if there is none.
      votes: whether it is played by a vote over its belief of the state, of what that policy does.
      compiled: what plays it, as far as that is there.
    """

    problem: Problem
    config: PlannerConfig
    params: Any
    policy_hyperparams: Mapping[str, Any]
    seed: int
    candidates: tuple[Mapping[str, Any], ...] = ()
    saved_underlying: AnySaved | None = None
    votes: bool = False
    compiled: Compiled = field(default_factory=Compiled)

    @classmethod
    def from_saved(cls, saved: SavedPolicy, problem: Problem, source: str) -> "Policy":
        """Compiles what plays a saved policy.

        Args:
          saved: the policy.
          problem: on which to play it, with whatever horizon the policy can be played for.
          source: where the policy came from, for error messages.

        Raises:
          InputError: if it was saved for another problem, its configuration cannot be used,
            or its tensors do not fit.
        """
        require_same_problem(saved, problem, source)
        config = PlannerConfig.from_text(saved.config, source)
        planner, formula = None, None
        if config.policy_method == METHOD:
            formula = FeedbackFormula(problem, config)
            require_formula_params(saved, formula, source)
        else:
            saved, planner = _fitted(saved, problem, config, source)
        own = saved.params, saved.policy_hyperparams, saved.seed, saved.candidates
        return cls(problem, config, *own, saved.underlying, saved.votes, Compiled(planner, formula))

    @property
    def planner(self) -> "MDPOPlanner":
        """The compiled planner, for whatever the formula on numpy does not do."""
        return self.compiled.planner(self.problem, self.config)

    @property
    def formula(self) -> FeedbackFormula | None:
        """What plays a feedback policy; None of another one."""
        return self.compiled.formula(self.problem, self.config)

    @property
    def greedy(self) -> GreedyFormula | None:
        """What plays a greedy policy; None of another one."""
        return self.compiled.greedy(self.problem, self.config)

    def to_saved(self) -> SavedPolicy:
        """The policy as a file holds it: without the compiled planner, and without times.

        The same parameters under the same configuration are the same file, found whenever.
        """
        return SavedPolicy(
            params=self.params,
            policy_hyperparams=dict(self.policy_hyperparams),
            config=self.config.to_text(),
            problem=problem_identity(self.problem),
            seed=self.seed,
            source=ProblemSource.of(self.problem).without_folders(),
            candidates=tuple(
                {name: value for name, value in each.items() if name != "seconds"}
                for each in self.candidates
            ),
            underlying=self.saved_underlying,
            votes=self.votes,
        )

    def save(self, path: str | Path) -> None:
        """Writes one file that stands alone, which `mdpo_rddl.load_policy` reads.

        Raises:
          InputError: naming the file, if it cannot be written.
        """
        save_policy(Path(path), self.to_saved())

    @property
    def rollout_policy(self) -> Callable[..., Any]:
        """What plays in compiled rollouts: of a greedy policy one with fewer samples."""
        from mdpo_rddl.planner.plans.greedy_plan import GreedyPlan

        plan = self.planner.plan
        return plan.rollout_policy if isinstance(plan, GreedyPlan) else self.planner.legal_policy

    @cached_property
    def underlying(self) -> "Policy | TablePolicy | RelaxedPlanPolicy | None":
        """The policy of the underlying MDP, compiled when it is first asked for.

        Raises:
          InputError: if it was saved for another problem, or cannot be used.
        """
        saved = self.saved_underlying
        if saved is None:
            return None
        cost, source = saved.problem.get("error_cost", 0.0), "the underlying MDP's policy"
        problem = problem_played(saved, underlying_mdp(self.problem, cost))
        if isinstance(saved, SavedTable):
            return TablePolicy.from_saved(saved, problem, source)
        if isinstance(saved, SavedPlanRule):
            return RelaxedPlanPolicy.from_saved(saved, problem, source)
        return Policy.from_saved(saved, problem, source)

    @property
    def returns(self) -> np.ndarray:
        """Mean return on the exact model of each incumbent, the policy's own last."""
        found = [each["mean_return"] for each in self.candidates if each["became_incumbent"]]
        return np.array(found, dtype=float)

    def with_params(self, params: Any) -> "Policy":
        """The policy with other parameters of the same planner."""
        return dataclasses.replace(self, params=params)

    def with_candidates(self, candidates: Sequence[Mapping[str, Any]]) -> "Policy":
        """The policy with what else planning judged; what was compiled for its play is kept."""
        return dataclasses.replace(self, candidates=tuple(candidates))._compiled_as(self)

    def voting_with(self, underlying: "Policy | TablePolicy | RelaxedPlanPolicy") -> "Policy":
        """The policy, played by a vote of what another one does.

        Args:
          underlying: of the underlying MDP.
        """
        saved = underlying.to_saved()
        voting = dataclasses.replace(self, saved_underlying=saved, votes=True)
        # it need not be compiled, or grounded, once more
        voting.__dict__["underlying"] = underlying
        return voting

    def voting_as(self, other: "Policy") -> "Policy":
        """The policy, played by another one's vote, which does not hang on the parameters.

        Args:
          other: votes, on the same problem and with the same seed.
        """
        saved = other.saved_underlying
        return dataclasses.replace(self, saved_underlying=saved, votes=True)._compiled_as(other)

    def _compiled_as(self, other: "Policy") -> "Policy":
        self.__dict__.update({n: v for n, v in vars(other).items() if n in _COMPILED})
        return self

    def with_decision_seconds(self, seconds: float) -> PolicyAgent:
        """The policy with time to think at each decision, where trials show that it pays.

        These last up to `20 + 40 * seconds` seconds. What is returned is this policy itself where
        thinking does not pay, or another agent, which is played in the same ways.

        Args:
          seconds: of a decision, the first included.

        Raises:
          InputError: if that is no time.
        """
        from mdpo_rddl.policy.lookahead.choice import thinking_agent

        return thinking_agent(self, seconds) or self

    def __call__(self, step: int, observation: Mapping[str, Any]) -> Mapping[str, Any]:
        """The action at a step.

        A policy with a memory takes part in one episode at a time: step 0 begins one.

        Args:
          step: number of decisions before.
          observation: per fluent an array, or per ground fluent a scalar.

        Returns:
          Per action fluent an array, or per ground action fluent a scalar, as the observation was.

        Raises:
          InputError: if there is no such step, or fluents are unknown, missing or of another shape.
        """
        model = self.problem.model
        require_step(model, step)
        require_observation(model, observation)
        if is_grounded(model, observation):
            return grounded(model, self(step, lifted(model, observation)))
        return self._exact(self._play(step, observation), observation)

    def reset(self) -> None:
        """Begins an episode; what the policy remembers is forgotten."""
        super().reset()
        self._play.reset()

    def was_played(self, actions: Mapping[str, Any]) -> None:
        """Takes in what was played at the latest step: a policy with a memory remembers that.

        Args:
          actions: per action fluent [*shape].
        """
        self._play.was_played(actions)

    def batch(self, step: int, observations: Mapping[str, Any]) -> dict[str, np.ndarray]:
        """The actions for many observations of one step, in one call.

        Args:
          step: number of decisions before.
          observations: per fluent its values [batch, *shape].

        Returns:
          Per action fluent [batch, *shape].

        Raises:
          InputError: as a call does, and if a policy that remembers is given another number than at
            the step before.
        """
        require_batch(self.problem.model, step, observations)
        return self._play.batch(step, observations)

    def replicated(self) -> Replicated | None:
        """See `PolicyAgent.replicated`; of a feedback policy its formula, without a compiler."""
        if self.votes and self.underlying is not None:
            return self._believing(self.underlying)
        if self.formula is not None:
            return self.formula.replicas(self.params)
        if (greedy := self.greedy) is not None:
            return greedy.replicas(self.params, self.seed)
        play = self._play
        return BatchReplicas(play.batch, play.were_played, self.problem.model)

    @property
    def vote(self) -> "Vote | None":
        """How it is played, if `votes`, in compiled code, for who thinks on from that."""
        return None if self._voting is None else self._voting.vote

    @cached_property
    def _voting(self) -> "ActionVoting | None":
        if not self.votes or self.underlying is None:
            return None
        from mdpo_rddl.policy.action_voting import ActionVoting

        return ActionVoting(self, self.underlying)

    def _believing(self, underlying: "Policy | TablePolicy | RelaxedPlanPolicy") -> BeliefReplicas:
        """What votes for many episodes at once."""
        simulator = self._exact_model
        if simulator is None:
            raise InputError(f"{self.problem.domain_path}: the simulator does not know it")
        if isinstance(underlying, Policy) and (greedy := underlying.greedy) is not None:
            elect = gaining(greedy, underlying.params, underlying.seed)
        elif isinstance(underlying, TablePolicy) and underlying.table.values is not None:
            elect = worth_most(simulator, underlying, underlying.seed)
        else:
            play = underlying.replicated()
            assert play is not None
            elect = voting(simulator, play, isinstance(underlying, RelaxedPlanPolicy))
        return BeliefReplicas(simulator, elect, self.seed)

    @cached_property
    def _play(self) -> Any:
        """A `BeliefPlay`, `FormulaPlay` or `Playable`, which are played alike."""
        if self.votes and (underlying := self.underlying) is not None:
            formula = self.formula
            if formula is None:
                plain = self.config.with_values("Planner", method=METHOD, method_kwargs={})
                formula = FeedbackFormula(self.problem, plain)
            return BeliefPlay(formula, lambda: self._believing(underlying))
        if self.formula is not None:
            return FormulaPlay(self.formula, self.params)
        from mdpo_rddl.policy.playable import playable

        return playable(self.planner, self.params, self.policy_hyperparams, self.seed)

    def explain(self, seconds: float = math.inf) -> "Explanation":
        """The lifted rule in words: an equation for each action fluent, the largest terms first.

        Args:
          seconds: for measuring what the return loses without each term; 0 measures nothing.
        """
        from mdpo_rddl.policy.rule.explanation import NO_RULE, Explanation, explain

        if self.votes:
            return Explanation((), "the policy is a vote over a belief of the state, not a rule")
        if self.formula is None:
            return Explanation((), NO_RULE)
        return explain(self.formula, self.params, seconds)

    def __repr__(self) -> str:
        return f"<Policy for {self.problem.label}: {self._kind}, {self._size:,} parameters>"

    @property
    def _kind(self) -> str:
        return "vote over a belief" if self.votes else self.config.policy_method

    @property
    def _size(self) -> int:
        """Number of its parameters."""
        return sum(map(np.size, flatten(self.params, "params").values()))

    def _repr_html_(self) -> str:
        rows = {
            "domain, instance": f"{self.problem.domain_name}, {self.problem.instance_name}",
            "horizon": f"{self.problem.horizon:,}",
            "plan": self._kind,
            "parameters": f"{self._size:,}",
            "seed": f"{self.seed}",
        }
        for each in self.candidates:
            if each["became_incumbent"] and each["mean_return"] is not None:
                after = f", {each['seconds']:.1f} s" if "seconds" in each else ""
                rows[f"{each['candidate']}{after}"] = f"{each['mean_return']:z,.2f}"
        return html_table(f"Policy for {self.problem.label}", rows)


def _fitted(
    saved: SavedPolicy, problem: Problem, config: PlannerConfig, source: str
) -> "tuple[SavedPolicy, MDPOPlanner]":
    """A policy of JaxPlan's kinds with its preprocessor's values, if it fits its planner."""
    from mdpo_rddl.machine.device import computing_on
    from mdpo_rddl.planner.build import build_planner
    from mdpo_rddl.planner.device import fitting_device
    from mdpo_rddl.planner.start import with_preprocessor
    from mdpo_rddl.policy.fitting import require_params, with_tuples

    with computing_on(fitting_device(problem)):
        planner = build_planner(problem, config).planner
    saved = with_tuples(saved, planner)
    require_params(saved, planner, source)
    hyperparams = with_preprocessor(planner, saved.policy_hyperparams)
    return dataclasses.replace(saved, policy_hyperparams=hyperparams), planner
