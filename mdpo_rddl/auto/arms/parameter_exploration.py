"""The arm that explores the parameters of a deep reactive policy: PGPE on the exact model."""

from typing import Any, NamedTuple

import jax
import numpy as np

from mdpo_rddl.auto.arena.arena import Arena
from mdpo_rddl.auto.arena.plain import REACTIVE
from mdpo_rddl.auto.arms.compiling import CompilingArm
from mdpo_rddl.auto.common.candidate import Candidate
from mdpo_rddl.auto.common.draws import Draws, key_for
from mdpo_rddl.auto.common.state import State, count_of, joined
from mdpo_rddl.auto.search.flat import Flat
from mdpo_rddl.auto.search.pgpe import Exploring, ParameterExploration
from mdpo_rddl.errors import Cancelled, note_heard
from mdpo_rddl.planner.exact.exact import compile_exact_returns
from mdpo_rddl.planner.start import initial_parameters, unit_hyperparams

PGPE = "pgpe"
_ROLLOUTS = 4
# of the deviation after a slice that found nothing better
_NARROWER = 0.5
# batches of fresh rollouts after a slice, and of its iterations: how many at most
_FRESH_BATCHES, _FRESH_SHARE = 8, 0.25
# no iteration has such a number
_FRESH = 10**6


class _Record(NamedTuple):
    """The best parameters so far [D], and what they returned in the latest fresh rollouts."""

    vector: np.ndarray
    mean_return: float


class ParameterExplorationArm(CompilingArm):
    """Offers the mean of the parameters after each slice, and the best ones if these differ.

    Of many samples in few rollouts each, the best is mostly a lucky one. The mean and the best
    sample of a slice meet the record of those before it in fresh rollouts, and what the best of
    them returns there is the arm's estimate. Only rollouts are compiled, in a thread while other
    arms work.
    """

    def __init__(self, arena: Arena, usual_seconds: float = 0.0) -> None:
        """Compiles nothing yet.

        Args:
          arena: what all arms have in common.
          usual_seconds: that its program is likely to take to compile.
        """
        super().__init__(PGPE, arena, usual_seconds)
        self._record: _Record | None = None
        self._is_stalled, self._fresh_number = False, _FRESH
        self._exploration: ParameterExploration | None = None
        self._resumed: State | None = None

    def is_worth_waiting(self, seconds: float) -> bool:
        """Whether others give way to its program in the rounds: they do not."""
        del seconds
        return False

    def state(self) -> State | None:
        """The exploration, and the record."""
        exploration, record = self._exploration, self._record
        if exploration is None:
            return self._resumed
        values: dict[str, Any] = {"is_stalled": self._is_stalled, "fresh": self._fresh_number}
        tensors: dict[str, np.ndarray] = {}
        if record is not None:
            tensors, values["record_return"] = {"record": record.vector}, record.mean_return
        return joined(State(tensors, values), exploration.state().within("exploration"))

    def restore(self, state: State) -> None:
        """Keeps it until the program is compiled."""
        state.part("exploration")  # raises if there is none
        self._resumed = state

    def _begin(self) -> None:
        self._start(self._compile)

    def _work(self, until: float) -> None:
        """Goes on exploring.

        Raises:
          Cancelled: if interrupted; the mean till then is offered if the judge can play it.
        """
        if not self._is_compiled(until):
            return
        exploration = self._exploration
        assert exploration is not None
        # where all samples return the same, the best is as good as any other
        if self._is_stalled and self._record is not None and not exploration.is_flat:
            exploration.narrow(_NARROWER, self._record.vector)
        before = exploration.iterations
        try:
            exploration.run(self._evaluate_and_tell, until)
        except (KeyboardInterrupt, Cancelled) as stop:
            note_heard(stop)
            if exploration.iterations > before and self._is_judged and not self.is_pending:
                self._offer(self._candidate("pgpe, mean", exploration.mean))
            raise
        self._log.iterations = exploration.iterations
        self._estimate = self._recorded(exploration.iterations - before)
        planner = self._arena.plain.built(REACTIVE).planner
        if self._may_be_judged(planner, self._params(exploration.best), until):
            self._offer(self._candidate("pgpe, mean", exploration.mean))
            if self._record is not None and self._record.vector is not exploration.mean:
                self._offer(self._candidate("pgpe, best", self._record.vector))

    def _compile(self) -> None:
        """Makes the policy and plays it once."""
        arena = self._arena
        planner = arena.plain.built(REACTIVE).planner
        key = key_for(Draws.PGPE, arena.seed)
        if (params := self._earlier_params(planner)) is None:
            params = jax.tree.map(lambda leaf: leaf[0], initial_parameters(planner, key))
        start, self._flat = Flat.vector(params), Flat(params)
        rollouts = 1 if arena.probe.certain else _ROLLOUTS
        self._returns = compile_exact_returns(planner, rollouts)
        self._key = jax.random.fold_in(key, 1)
        exploring = Exploring(seed=arena.seed)
        exploration = ParameterExploration(np.asarray(start), exploring, self._clock)
        if self._resumed is not None and not self._try(
            lambda state: self._go_on(exploration, state), self._resumed
        ):
            exploration = ParameterExploration(np.asarray(start), exploring, self._clock)
        self._exploration = exploration
        self._evaluate(0, np.repeat(np.asarray(start)[np.newaxis], 2 * exploring.pairs, axis=0))

    def _go_on(self, exploration: ParameterExploration, state: State) -> None:
        """Restores the exploration and the record, which are compared again."""
        values, record = state.values, None
        if "record" in state.tensors:
            vector = state.array("record", exploration.mean.shape).astype(float)
            record = _Record(vector, float(values["record_return"]))
        fresh = count_of(values["fresh"])
        exploration.restore(state.part("exploration"))
        self._record, self._fresh_number = record, max(_FRESH, fresh)
        self._is_stalled = bool(values["is_stalled"])
        if record is not None and np.isfinite(record.mean_return):
            self._estimate = record.mean_return

    def _evaluate_and_tell(self, iteration: int, vectors: np.ndarray) -> np.ndarray:
        self._arena.pulse()
        return self._evaluate(iteration, vectors)

    def _evaluate(self, iteration: int, vectors: np.ndarray) -> np.ndarray:
        """Mean returns [P] of vectors [P, D]."""
        key = jax.random.fold_in(self._key, iteration)
        params = self._flat.tree(vectors)
        return np.mean(np.asarray(self._returns(key, params), float), axis=1)

    def _recorded(self, iterations: int) -> float:
        """What the record returns in fresh rollouts, after a slice of so many iterations."""
        exploration, record = self._exploration, self._record
        assert exploration is not None
        vectors = [exploration.mean, exploration.best]
        vectors = vectors if record is None else [record.vector, *vectors]
        batches = max(1, min(_FRESH_BATCHES, int(_FRESH_SHARE * iterations)))
        means = self._fresh(vectors, 1 if self._arena.probe.certain else batches)
        best = int(np.argmax(means))
        self._is_stalled = record is not None and best == 0
        self._record = _Record(vectors[best], float(means[best]))
        return self._record.mean_return

    def _fresh(self, vectors: list[np.ndarray], batches: int) -> np.ndarray:
        """Mean returns of a few vectors [N] in rollouts that no sample was chosen by."""
        places = np.arange(2 * Exploring().pairs) % len(vectors)
        samples = np.stack(vectors)[places]
        found = []
        for _ in range(batches):
            self._fresh_number += 1
            found.append(self._evaluate(self._fresh_number, samples))
        means = np.mean(found, axis=0)[: len(vectors)]
        return np.where(np.isfinite(means), means, -np.inf)

    def _params(self, vector: np.ndarray) -> Any:
        return self._flat.tree(vector)

    def _candidate(self, label: str, vector: np.ndarray) -> Candidate:
        plain = self._arena.plain
        planner = plain.built(REACTIVE).planner
        return Candidate(
            arm=self.name,
            label=label,
            config=plain.config(REACTIVE),
            planner=planner,
            params=self._params(vector),
            policy_hyperparams=unit_hyperparams(planner),
        )
