"""Robots are sent to parcels at least total distance and move in turn, loaded ones first.

They follow shortest ways that keep clear of the others.
"""

from collections import deque
from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from scipy.optimize import linear_sum_assignment

Cell = tuple[int, int]

WALLS = {(2, 2), (2, 4), (3, 4), (3, 6), (3, 7), (4, 2), (5, 5), (5, 6), (7, 3)}
CELLS = {(x, y) for x in range(1, 8) for y in range(1, 8)} - WALLS
DEPOT = ((3, 1), (4, 1))
RESTS = ((3, 3), (5, 4), (2, 5), (6, 5))
"""Where robots wait for parcels."""
ROBOTS = ("r1", "r2", "r3", "r4")
MOVES = {0: (0, 0), 1: (0, 1), 2: (1, 0), 3: (0, -1), 4: (-1, 0)}
STEPS = (1, 2, 3, 4)
HORIZON = 60
WAY_BACK = 0.3
"""What a step from a parcel to the depot counts when robots choose parcels."""
PATIENCE = 3
"""Each robot that is stuck steps aside once in so many steps."""
_FAR = 99


def after(cell: Cell, move: int) -> Cell:
    """Where a move from a cell leads."""
    return cell[0] + MOVES[move][0], cell[1] + MOVES[move][1]


def distances(goals: Iterable[Cell], shut: Collection[Cell] = ()) -> dict[Cell, int]:
    """The distance of each cell from the nearest goal, on ways that keep off what is shut."""
    found = dict.fromkeys(goals, 0)
    queue = deque(found)
    while queue:
        cell = queue.popleft()
        for move in STEPS:
            ahead = after(cell, move)
            if ahead in CELLS and ahead not in found and ahead not in shut:
                found[ahead] = found[cell] + 1
                queue.append(ahead)
    return found


FROM_CELL = {cell: distances([cell]) for cell in CELLS}
FROM_DEPOT = distances(DEPOT)


def assigned(costs: Sequence[Sequence[float]]) -> list[tuple[int, int]]:
    """Pairs of a row and a column of least total cost."""
    rows, columns = linear_sum_assignment(np.array(costs))
    return list(zip(rows.tolist(), columns.tolist(), strict=True))


def goals_of(
    state: Mapping[str, Any], step: int, places: Mapping[str, Cell]
) -> dict[str, Sequence[Cell]]:
    """Where each robot is to go: to the depot, a parcel or a place of rest."""
    goals: dict[str, Sequence[Cell]] = {r: DEPOT for r in ROBOTS if state[f"loaded___{r}"]}
    empty = [robot for robot in ROBOTS if robot not in goals]
    parcels = [
        cell
        for cell in CELLS
        if state[f"parcel___c{cell[0]}{cell[1]}"] and FROM_DEPOT[cell] < HORIZON - step
    ]
    if empty and parcels:
        costs = [
            [FROM_CELL[cell][places[robot]] + WAY_BACK * FROM_DEPOT[cell] for cell in parcels]
            for robot in empty
        ]
        for row, column in assigned(costs):
            goals[empty[row]] = [parcels[column]]
    idle = [robot for robot in empty if robot not in goals]
    if idle:
        ways = [[FROM_CELL[cell][places[robot]] for cell in RESTS] for robot in idle]
        for row, column in assigned(ways):
            goals[idle[row]] = [RESTS[column]]
    return goals


def way(here: Cell, goals: Sequence[Cell], shut: Collection[Cell]) -> dict[Cell, int]:
    """The distances that a robot follows: a detour around the others may take one step more."""
    direct = distances(goals)
    around = distances([goal for goal in goals if goal not in shut], shut)
    return around if here in around and around[here] <= direct[here] + 1 else direct


def best_move(here: Cell, way: Mapping[Cell, int], shut: Collection[Cell]) -> int:
    """The move that comes nearest to the goal, or 0."""
    open_moves = [move for move in STEPS if after(here, move) not in shut]
    best = min(open_moves, key=lambda move: way.get(after(here, move), _FAR), default=0)
    return best if way.get(after(here, best), _FAR) < way.get(here, _FAR) else 0


def aside(here: Cell, shut: Collection[Cell], step: int) -> int:
    """A move out of the way, another one in each step; 0 if there is none."""
    cells = {move: after(here, move) for move in STEPS}
    free = [move for move, cell in cells.items() if cell in CELLS and cell not in shut]
    return free[step % len(free)] if free else 0


def rule(state: Mapping[str, Any], step: int) -> dict[str, Any]:
    """The moves of the robots."""
    places = {r: (int(state[f"px___{r}"]), int(state[f"py___{r}"])) for r in ROBOTS}
    goals = goals_of(state, step, places)
    loaded = {robot: bool(state[f"loaded___{robot}"]) for robot in ROBOTS}
    left = {robot: distances(goals[robot])[places[robot]] for robot in ROBOTS}
    actions, taken = {}, set[Cell]()
    for number, robot in sorted(
        enumerate(ROBOTS), key=lambda each: (not loaded[each[1]], left[each[1]])
    ):
        here = places[robot]
        shut = taken | {places[other] for other in ROBOTS if other != robot}
        followed = way(here, goals[robot], shut)
        move = best_move(here, followed, shut)
        is_blocking = here in DEPOT and not loaded[robot]
        is_its_turn = followed.get(here, _FAR) > 0 and step % PATIENCE == number % PATIENCE
        if move == 0 and (is_blocking or is_its_turn):
            move = aside(here, shut, step)
        actions[f"move___{robot}"] = move
        taken.add(after(here, move))
    return actions
