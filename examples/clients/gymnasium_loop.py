"""A planner of MDPO in gymnasium's loop, as an agent of JaxPlan's would be.

python examples/clients/gymnasium_loop.py Reservoir_ippc2023 1 --epochs 300
"""

import argparse

import jax
import optax
import pyRDDLGym

# from pyRDDLGym_jax.core.planner import JaxBackpropPlanner, JaxOfflineController, ...
from mdpo_rddl import JaxOfflineController, JaxStraightLinePlan, MDPOPlanner


def play(domain: str, instance: str, epochs: int, seed: int) -> float:
    """Trains a straight-line plan and returns the sum of rewards of one episode."""
    env = pyRDDLGym.make(domain, instance, vectorized=True)
    planner = MDPOPlanner(
        env.model,
        JaxStraightLinePlan(),
        batch_size_train=8,
        optimizer=optax.rmsprop,
        optimizer_kwargs={"learning_rate": 0.1},
        pgpe=None,
    )
    agent = JaxOfflineController(
        planner, key=jax.random.PRNGKey(seed), epochs=epochs, print_summary=False
    )
    observation, _ = env.reset(seed=seed)
    total, terminated, truncated = 0.0, False, False
    while not (terminated or truncated):
        action = agent.sample_action(observation)
        observation, reward, terminated, truncated, _ = env.step(action)
        total += reward
    env.close()
    return total


def main() -> None:
    """Reads the arguments and prints the return."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("domain")
    parser.add_argument("instance")
    parser.add_argument("--epochs", type=int, default=300)
    parser.add_argument("--seed", type=int, default=0)
    chosen = parser.parse_args()
    print(f"return: {play(chosen.domain, chosen.instance, chosen.epochs, chosen.seed):,.2f}")


if __name__ == "__main__":
    main()
