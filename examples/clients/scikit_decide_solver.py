"""scikit-decide's JaxPlan solver with MDPO's planner.

    make test-clients    # an environment of its own, since its pins differ
    .venv-clients/bin/python examples/clients/scikit_decide_solver.py Reservoir_ippc2023 1 FILE.cfg

The solver is scikit-decide's own class: only what it takes from `pyRDDLGym_jax.core.planner` is
taken from `mdpo_rddl` instead, which is the one changed import. As a plugin of pytest the file does
so for scikit-decide's own tests (`tests/solvers/python/test_pyrddlgym_solvers.py` there):

    PYTHONPATH=examples/clients .venv-clients/bin/pytest -p scikit_decide_solver FILE
"""

import sys

from skdecide.hub.domain.rddl import RDDLDomain
from skdecide.hub.solver.rddl import rddl as solvers

import mdpo_rddl


def use_mdpo() -> None:
    """Changes what scikit-decide's solver has imported from JaxPlan."""
    solvers.JaxBackpropPlanner = mdpo_rddl.MDPOPlanner
    solvers.JaxOfflineController = mdpo_rddl.JaxOfflineController
    solvers.load_config = mdpo_rddl.load_config


def pytest_configure() -> None:
    """What pytest calls before it collects tests."""
    use_mdpo()


def play(domain: str, instance: str, config: str, episodes: int = 1, seed: int = 0) -> list[float]:
    """Solves a problem and returns the sums of rewards of some episodes.

    Args:
      domain: its name or file.
      instance: its number or file.
      config: a configuration of JaxPlan's form.
      episodes: how many to play.
      seed: of the first episode; each has the next.
    """

    def make_domain() -> RDDLDomain:
        return RDDLDomain(domain, instance, display_with_pygame=False, vectorized=True)

    returns = []
    with solvers.RDDLJaxSolver(make_domain, config=config) as solver:
        solver.solve()
        played = make_domain()
        for episode in range(episodes):
            observation, _ = played.rddl_gym_env.reset(seed=seed + episode)
            total, ended = 0.0, False
            while not ended:
                outcome = played.step(solver.sample_action(observation))
                observation, ended = outcome.observation, outcome.termination
                total += outcome.value.reward
            returns.append(float(total))
    return returns


if __name__ == "__main__":
    use_mdpo()
    print("returns:", play(*sys.argv[1:4]))
