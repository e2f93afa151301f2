"""What follows each of many states: rewards, next states and their probabilities."""

from typing import Any, NamedTuple

import numpy as np

from mdpo_rddl.problem.enumeration.graph import Kind
from mdpo_rddl.problem.enumeration.laws import Law
from mdpo_rddl.problem.enumeration.limits import EnumerationLimits, NotEnumerableError
from mdpo_rddl.problem.enumeration.model import ActionRules, GroundModel
from mdpo_rddl.problem.enumeration.program import Program

_TOLERANCE = 1e-9


class Successors(NamedTuple):
    """What follows N states.

    A row is a state with an action that is worth considering there, a transition one of its
    successors. Rows are sorted by state.

    Attributes:
      state: of each row, which of the N states [R].
      action: of each row, its number in the model [R].
      reward: expected reward of each row [R].
      row: of each transition [M].
      states: next state of each transition, packed [M, words].
      probability: of each transition [M]; those of a row sum to 1.
    """

    state: np.ndarray
    action: np.ndarray
    reward: np.ndarray
    row: np.ndarray
    states: np.ndarray
    probability: np.ndarray


class _Draws(NamedTuple):
    """Partly drawn next states: the row, the packed values and the probability of each."""

    row: np.ndarray
    states: np.ndarray
    probability: np.ndarray

    def take(self, chosen: np.ndarray) -> "_Draws":
        return _Draws(self.row[chosen], self.states[chosen], self.probability[chosen])


class Expander:
    """Finds the successors of states, many at a time."""

    def __init__(self, model: GroundModel, limits: EnumerationLimits) -> None:
        """Orders the evaluation of the model's rules."""
        self._model, self._limits = model, limits
        graph = model.graph
        self._leaves = [
            (number, graph.leaf(Kind.STATE, ground, model.is_bool[number]))
            for number, ground in enumerate(model.variables[: model.state_variables])
        ]
        self._drawn = [
            (number, graph.leaf(Kind.DRAWN, self._name(number), model.is_bool[number]))
            for number in range(len(model.variables))
        ]
        outputs = {node for action in model.actions for node in action.nodes()}
        known = [node for node in outputs if not graph.depends[node] & Kind.DRAWN]
        self._program = Program(graph, [*known, model.ends])
        self._late = [self._late_programs(action) for action in model.actions]
        default = model.actions[0].laws
        self._differs = [
            [number for number, law in enumerate(action.laws) if law != default[number]]
            for action in model.actions
        ]
        self._state_mask = np.zeros(model.packing.words, np.uint64)
        for place in model.packing.places[: model.state_variables]:
            self._state_mask[place.word] |= place.mask

    @property
    def operations(self) -> int:
        """Number of operations on each state."""
        return self._program.size

    def ended(self, states: np.ndarray) -> np.ndarray:
        """Whether the episode has ended in states [N, words]."""
        model = self._model
        program = Program(model.graph, [model.ends])
        ends = program.run(self._columns(states))[model.ends]
        return np.broadcast_to(ends, len(states))

    def expand(self, states: np.ndarray) -> Successors:
        """The successors of states [N, words] in which the episode goes on.

        Raises:
          NotEnumerableError: if a state has no legal action, or a probability is none.
        """
        columns = self._columns(states)
        values = self._program.run(columns)
        found, rows, total, allowed = [], 0, 0, np.zeros(len(states), bool)
        default = self._values(values, self._model.actions[0].legal, len(states)).astype(bool)
        for number, action in enumerate(self._model.actions):
            legal = self._values(values, action.legal, len(states)).astype(bool)
            allowed |= legal
            if number:
                legal = legal & ~(default & self._is_default(number, values, len(states)))
            chosen = np.flatnonzero(legal)
            if not len(chosen):
                continue
            draws = self._draw(number, chosen, states, values, total)
            total += len(draws.row)
            reward = self._reward(number, chosen, columns, values, draws)
            found.append((chosen, np.full(len(chosen), number), reward, draws, rows))
            rows += len(chosen)
        if not allowed.all():
            raise NotEnumerableError("a reachable state without a legal action")
        return self._sorted(found)

    def _name(self, number: int) -> Any:
        name, place = self._model.variables[number]
        return (f"{name}'", place) if number < self._model.state_variables else (name, place)

    def _columns(self, states: np.ndarray) -> dict[int, np.ndarray]:
        packing = self._model.packing
        return {leaf: packing.decode(number, states) for number, leaf in self._leaves}

    def _late_programs(self, action: ActionRules) -> dict[int, Program]:
        """Per stage after the first the program of its laws; at -1 that of a late reward."""
        model = self._model
        programs = {}
        for stage in range(1, max(model.stages, default=0) + 1):
            numbers = [n for n, own in enumerate(model.stages) if own == stage]
            nodes = [node for n in numbers for branch in action.laws[n] for node in branch]
            programs[stage] = Program(model.graph, nodes)
        if model.graph.depends[action.reward] & Kind.DRAWN:
            programs[-1] = Program(model.graph, [action.reward])
        return programs

    @staticmethod
    def _values(values: dict[int, Any], node: int, count: int) -> np.ndarray:
        return np.broadcast_to(values[node], count)

    def _is_default(self, number: int, values: dict[int, Any], count: int) -> np.ndarray:
        """Where an action does what the default action does, and earns no more [N]."""
        action, default = self._model.actions[number], self._model.actions[0]
        nodes = [
            pair
            for each in self._differs[number]
            for branches in zip(action.laws[each], default.laws[each], strict=True)
            for pair in zip(*branches, strict=True)
        ]
        nodes.append((action.reward, default.reward))
        if any(own != other and not {own, other} <= values.keys() for own, other in nodes):
            return np.zeros(count, bool)
        *laws, (own, other) = nodes
        same = np.ones(count, bool)
        if own != other:
            same = np.broadcast_to(values[own] <= values[other], count).copy()
        for one, another in laws:
            if one != another:
                same &= values[one] == values[another]
        return same

    def _draw(
        self,
        number: int,
        chosen: np.ndarray,
        states: np.ndarray,
        values: dict[int, Any],
        before: int,
    ) -> _Draws:
        """Next states of some rows of one action, the rows numbered from 0."""
        model, action = self._model, self._model.actions[number]
        packed = np.zeros((len(chosen), model.packing.words), np.uint64)
        draws = _Draws(np.arange(len(chosen)), packed, np.ones(len(chosen)))
        for stage in range(max(model.stages, default=0) + 1):
            at = chosen
            if stage:
                at, values = None, self._late_values(number, stage, chosen, states, draws)
            start = draws.row if at is not None else np.arange(len(draws.row))
            draws = self._draw_stage(stage, action, (values, at, start), draws, before)
        return draws

    def _late_values(
        self, number: int, stage: int, chosen: np.ndarray, states: np.ndarray, draws: _Draws
    ) -> dict[int, Any]:
        columns = self._columns(states[chosen[draws.row]])
        columns |= self._drawn_columns(draws)
        return self._late[number][stage].run(columns)

    def _drawn_columns(self, draws: _Draws) -> dict[int, np.ndarray]:
        packing = self._model.packing
        return {leaf: packing.decode(each, draws.states) for each, leaf in self._drawn}

    def _draw_stage(
        self,
        stage: int,
        action: ActionRules,
        known: tuple[dict[int, Any], np.ndarray | None, np.ndarray],
        draws: _Draws,
        before: int,
    ) -> _Draws:
        """Adds the values of one stage's variables.

        `known` has the values of the nodes, the places in them of what the draws' origins
        number, and the origins.
        """
        values, at, origin = known
        count = len(origin) if at is None else len(at)
        model = self._model

        def of(node: int) -> np.ndarray:
            value = values[node]
            if np.ndim(value) == 0:
                return np.broadcast_to(value, count)
            return value if at is None else value[at]

        random = []
        for number, law in enumerate(action.laws):
            if model.stages[number] != stage:
                continue
            first = of(law[0].value)
            if len(law) > 1 or (model.is_bool[number] and self._is_random(first)):
                random.append((number, law))
                continue
            word = model.packing.places[number].word
            draws.states[:, word] |= self._encode(number, first)[origin]
        for number, law in random:
            draws, origin = self._branch(number, self._outcomes(number, law, of), draws, origin)
            self._limits.check_transitions(before + len(origin))
        return draws

    @staticmethod
    def _is_random(probability: np.ndarray) -> bool:
        if probability.dtype == bool:
            return False
        if not np.all((probability >= -_TOLERANCE) & (probability <= 1 + _TOLERANCE)):
            raise NotEnumerableError("a probability outside of [0, 1]")
        return bool(np.any((probability > 0) & (probability < 1)))

    def _outcomes(self, number: int, law: Law, of: Any) -> list[tuple[np.ndarray, np.ndarray]]:
        """Values and their probabilities, both of every origin."""
        if self._model.is_bool[number]:
            true = np.clip(of(law[0].value), 0.0, 1.0)
            return [(np.ones(len(true), bool), true), (np.zeros(len(true), bool), 1 - true)]
        return [(of(value), of(probability)) for value, probability in law]

    def _branch(
        self,
        number: int,
        outcomes: list[tuple[np.ndarray, np.ndarray]],
        draws: _Draws,
        origin: np.ndarray,
    ) -> tuple[_Draws, np.ndarray]:
        """Every draw, once for each outcome of a variable that has a positive probability."""
        word = self._model.packing.places[number].word
        parts, origins = [], []
        for value, probability in outcomes:
            own = probability[origin]
            chosen = np.flatnonzero(own > 0)
            part = draws.take(chosen)
            part.states[:, word] |= self._encode(number, value)[origin[chosen]]
            parts.append(part._replace(probability=part.probability * own[chosen]))
            origins.append(origin[chosen])
        return _Draws(*map(np.concatenate, zip(*parts, strict=True))), np.concatenate(origins)

    def _encode(self, number: int, values: np.ndarray) -> np.ndarray:
        if np.any(values != np.round(values)) if values.dtype.kind == "f" else False:
            raise NotEnumerableError("a state that is no whole number")
        try:
            return self._model.packing.encode(number, values)
        except OverflowError as error:
            raise NotEnumerableError(str(error)) from error

    def _reward(
        self,
        number: int,
        chosen: np.ndarray,
        columns: dict[int, np.ndarray],
        values: dict[int, Any],
        draws: _Draws,
    ) -> np.ndarray:
        node = self._model.actions[number].reward
        if -1 not in self._late[number]:
            return np.broadcast_to(values[node], len(columns[next(iter(columns))]))[chosen] * 1.0
        at = chosen[draws.row]
        late = {leaf: column[at] for leaf, column in columns.items()}
        late |= self._drawn_columns(draws)
        rewards = np.broadcast_to(self._late[number][-1].run(late)[node], len(at))
        return np.bincount(draws.row, rewards * draws.probability, len(chosen))

    def _sorted(self, found: list[Any]) -> Successors:
        """All actions' rows in the order of their states."""
        states, actions, rewards, draws, first = zip(*found, strict=True)
        state, action = np.concatenate(states), np.concatenate(actions)
        order = np.argsort(state, kind="stable")
        rank = np.empty_like(order)
        rank[order] = np.arange(len(order))
        row = np.concatenate([each.row + start for each, start in zip(draws, first, strict=True)])
        return Successors(
            state=state[order],
            action=action[order].astype(np.int32),
            reward=np.concatenate(rewards)[order],
            row=rank[row],
            states=np.concatenate([each.states for each in draws]) & self._state_mask,
            probability=np.concatenate([each.probability for each in draws]),
        )
