"""Whether it is worth asking for the reachable states of a problem."""

from mdpo_rddl.problem.enumeration.packing import sizes_of
from mdpo_rddl.problem.load import Problem


def is_discrete(problem: Problem) -> bool:
    """Whether all states and actions are discrete, and the states observed."""
    rddl = problem.model
    if rddl.observ_fluents:
        return False
    ranges = [rddl.variable_ranges[name] for name in (*rddl.state_fluents, *rddl.action_fluents)]
    try:
        sizes_of(ranges, rddl.type_to_objects)
    except KeyError:
        return False
    return True
