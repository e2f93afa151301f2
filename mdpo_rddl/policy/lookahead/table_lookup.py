"""A table's actions, looked up in compiled rollouts."""

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import Array

from mdpo_rddl.policy.table import ActionTable

# numbers of runs and steps are 32 bits wide in compiled code
_MOST, _MOST_BITS = 2**31, 31
_SEED = 0


class MergeStage(NamedTuple):
    """M merges, none of which changes what a later one of them reads.

    A state's bools b [V] differ from what merge m asks for in `b @ weights[:, m] + true[m]` places.

    Attributes:
      weights: of each variable 1 where it must be false, -1 where it must be true, else 0 [V, M].
      true: of each merge how many must be true [M].
      drops: of each merge 1 for the variables that do not matter, else 0 [M, V].
    """

    weights: Any
    true: Any
    drops: Any


class TableArrays(NamedTuple):
    """A table of S states with R runs and A actions, sorted by the first hash.

    Attributes:
      factors: of each of V variables in the two hashes [V, 2].
      hashes: of the states' codes [S, 2]; no two states have both in common.
      merges: see `MergeStage`, in the order in which they are applied.
      last_run: of each state [S].
      run_key: of each run, its state's place times the number of steps, plus its last step [R].
      action: of each run [R].
      actions: per action fluent the values of all actions [A, *shape].
      values: of the states at each step [H, S]; None if they were not kept.
    """

    factors: Any
    hashes: Any
    merges: Any
    last_run: Any
    run_key: Any
    action: Any
    actions: Mapping[str, Any]
    values: Any = None


class TableLookup:
    """A table as a compiled policy, the same as `TablePolicy` plays; unknown states get the no-op.

    A state's code is an unsigned number for each of its variables, as the packed state has it.

    Attributes:
      arrays: what the policy takes for its parameters.
    """

    def __init__(self, table: ActionTable) -> None:
        """Sorts the table by its hashes.

        Raises:
          ValueError: if it is too large, has no states, or one of them twice.
        """
        self._fluents, places = table.fluents, table.places
        self._offsets = places[:, 3].astype(np.int32)
        self._steps = int(table.until_step.max(initial=0)) + 1
        bits, widest = places[:, 2], int(places[:, 2].max(initial=1))
        if len(table.states) * self._steps >= _MOST or widest > _MOST_BITS:
            raise ValueError("the table is too large")
        self._ends = (np.uint64(1) << bits.astype(np.uint64)).astype(np.uint32)
        codes = np.stack([_code(table.states[:, p[0]], p) for p in places], axis=1)
        if not len(codes):
            raise ValueError("the table has no states")
        factors, hashes = _distinct(codes)
        order = np.lexsort((hashes[:, 1], hashes[:, 0]))
        counts = np.diff(table.first_run)[order]
        ends = np.cumsum(counts)
        runs = np.repeat(table.first_run[:-1][order] - (ends - counts), counts) + np.arange(
            ends[-1]
        )
        state = np.repeat(np.arange(len(order)), counts)
        self._ties = int(np.unique(hashes[:, 0], return_counts=True)[1].max())
        self.arrays = TableArrays(
            factors=factors,
            hashes=hashes[order],
            merges=_merges(table),
            last_run=(ends - 1).astype(np.int32),
            run_key=(state * self._steps + table.until_step[runs]).astype(np.int32),
            action=table.action[runs].astype(np.int32),
            actions=dict(table.actions),
            values=None if table.values is None else table.values[:, order],
        )

    @property
    def policy(self) -> Callable[..., dict[str, Array]]:
        """A function as a planner's policy is, whose parameters are the arrays."""

        def play(
            key: Array, arrays: TableArrays, hyperparams: Any, step: Any, fluents: Any, memory: Any
        ) -> dict[str, Array]:
            number = self.number(arrays, step, fluents)
            return {name: jnp.asarray(each)[number] for name, each in arrays.actions.items()}

        return play

    def value(self, arrays: TableArrays, step: Any, fluents: Mapping[str, Any]) -> Array:
        """What the best policy returns from a step and a state on.

        A state that is not in the table, as no policy comes to it, counts as the worst one. Nor are
        those in the table in which an episode has ended: whoever asks must tell these.

        Args:
          arrays: of a table that has values.
          step: number of decisions before.
          fluents: per state fluent [*shape].
        """
        place, is_known = self._place(arrays, fluents)
        values = jnp.asarray(arrays.values)
        now = values[jnp.minimum(step, len(values) - 1)]
        found = jnp.where(is_known, now[place], jnp.min(now))
        return jnp.where(step < len(values), found, 0.0)

    def number(self, arrays: TableArrays, step: Any, fluents: Mapping[str, Any]) -> Array:
        """The number of the action; 0, the no-op's, for an unknown state."""
        place, is_known = self._place(arrays, fluents)
        wanted = place * self._steps + jnp.minimum(step, self._steps - 1)
        run = jnp.searchsorted(jnp.asarray(arrays.run_key), wanted.astype(jnp.int32))
        run = jnp.minimum(run, jnp.asarray(arrays.last_run)[place])
        return jnp.where(is_known, jnp.asarray(arrays.action)[run], 0)

    def _place(self, arrays: TableArrays, fluents: Mapping[str, Any]) -> tuple[Array, Array]:
        """The number of a state, and whether there is such a state."""
        values = [jnp.ravel(fluents[name]).astype(jnp.int32) for name in self._fluents]
        shifted = jnp.concatenate(values) + self._offsets
        codes = shifted.astype(jnp.uint32)
        fits = jnp.all((shifted >= 0) & (codes < self._ends))
        for stage in arrays.merges:
            codes = _merged(codes, stage)
        products = codes[:, None] * jnp.asarray(arrays.factors)
        # modulo 2^32, where numbers of 64 bits are enabled too
        first, second = jnp.sum(products, axis=0, dtype=jnp.uint32)
        hashes = jnp.asarray(arrays.hashes)
        places = jnp.searchsorted(hashes[:, 0], first) + jnp.arange(self._ties)
        places = jnp.minimum(places, len(hashes) - 1)
        hits = (hashes[places, 0] == first) & (hashes[places, 1] == second)
        return places[jnp.argmax(hits)].astype(jnp.int32), fits & jnp.any(hits)


def _merged(codes: Array, stage: MergeStage) -> Array:
    differing = (codes == 1).astype(jnp.float32) @ jnp.asarray(stage.weights) + stage.true
    # as products of matrices, which are faster than masks where many states are looked up
    dropped = (differing == 0).astype(jnp.float32) @ jnp.asarray(stage.drops)
    return jnp.where(dropped > 0, jnp.uint32(0), codes)


def _code(words: np.ndarray, place: np.ndarray) -> np.ndarray:
    """The bits of a variable [N] of its words [N]."""
    _, shift, bits, _ = (np.uint64(each) for each in place)
    return ((words >> shift) & ((np.uint64(1) << bits) - np.uint64(1))).astype(np.uint32)


def _merges(table: ActionTable) -> tuple[MergeStage, ...]:
    """The merges, as many together as change nothing that a later one of them reads.

    Raises:
      ValueError: if one reads what is no bool, or keeps a part of a variable.
    """
    codes = np.stack([_code(table.merges[..., place[0]], place) for place in table.places], axis=-1)
    reads, true, drops = codes[:, 0] > 0, codes[:, 1] > 0, codes[:, 2] == 0
    is_whole = drops | (codes[:, 2] == np.uint64(2) ** table.places[:, 2].astype(np.uint64) - 1)
    if np.any(reads & (table.places[:, 2] > 1)) or not np.all(is_whole):
        raise ValueError("states are joined by what is no bool")
    starts, dropped = [0], np.zeros(reads.shape[1], bool)
    for number, (own_reads, own_drops) in enumerate(zip(reads, drops, strict=True)):
        if np.any(dropped & own_reads):
            starts.append(number)
            dropped = np.zeros_like(dropped)
        dropped = dropped | own_drops
    stages = [
        MergeStage(
            weights=np.where(reads[part], np.where(true[part], -1, 1), 0).T.astype(np.float32),
            true=np.sum(true[part], axis=1).astype(np.float32),
            drops=drops[part].astype(np.float32),
        )
        for part in map(slice, starts, [*starts[1:], len(reads)])
    ]
    return tuple(stages) if len(reads) else ()


def _distinct(codes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Factors [V, 2] with which no two of the codes [S, V] have the same hashes [S, 2].

    Raises:
      ValueError: if two codes are the same.
    """
    random = np.random.default_rng(_SEED)
    while True:
        factors = random.integers(2**32, size=(codes.shape[1], 2), dtype=np.uint32) | np.uint32(1)
        hashes = np.zeros((len(codes), 2), np.uint32)
        for variable, own in enumerate(factors):
            hashes += codes[:, variable, np.newaxis] * own
        if len(np.unique(hashes, axis=0)) == len(hashes):
            return factors, hashes
        if len(np.unique(codes, axis=0)) < len(codes):
            raise ValueError("the table has a state twice")
