"""PPO of stable-baselines3 on the vector environment, and on pyRDDLGym-rl's beside it.

python examples/reinforcement/ppo.py CartPole_Discrete_gym 0 --steps 100000

It needs stable-baselines3, and for the comparison pyRDDLGym-rl 0.2.
"""

import argparse
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from gymnasium import spaces, wrappers
from gymnasium.vector import VectorEnv
from gymnasium.wrappers.vector import FlattenObservation, TransformAction
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import VecEnv, VecNormalize

import mdpo_rddl

# of real actions that the problem does not bound
LARGEST = 10.0


def with_flat_actions(vec: VectorEnv) -> VectorEnv:
    """One array of actions in place of a dictionary, as PPO takes them.

    Real ones from -1 to 1 for their bounds, or numbers of values where none is real.
    """
    boxes = list(vec.single_action_space.items())
    low, high = (
        np.concatenate([np.ravel(getattr(box, side)) for _, box in boxes])
        for side in ("low", "high")
    )
    if all(box.dtype.kind == "f" for _, box in boxes):
        low, high = np.maximum(low, -LARGEST), np.minimum(high, LARGEST)
        flat, scale = spaces.Box(-1.0, 1.0, low.shape), (high - low) / 2
        low = low + scale
    else:
        flat, scale = spaces.MultiDiscrete(high - low + 1), 1
    ends = np.cumsum([int(np.prod(box.shape)) for _, box in boxes])

    def as_dictionary(actions: np.ndarray) -> dict[str, np.ndarray]:
        parts = np.split(low + scale * actions, ends[:-1], axis=1)
        return {
            name: part.reshape(len(part), *box.shape)
            for (name, box), part in zip(boxes, parts, strict=True)
        }

    return TransformAction(vec, as_dictionary, single_action_space=flat)


class ForStableBaselines(VecEnv):
    """A vector environment of Gymnasium's that resets nothing by itself, as stable-baselines3's."""

    def __init__(self, vec: VectorEnv) -> None:
        super().__init__(vec.num_envs, vec.single_observation_space, vec.single_action_space)
        self.vec = vec

    def reset(self) -> np.ndarray:
        """The observations in which all episodes begin."""
        seed = self._seeds[0]
        self._reset_seeds()
        return self.vec.reset(seed=seed)[0]

    def step_async(self, actions: np.ndarray) -> None:
        """Keeps the actions."""
        self.actions = actions

    def step_wait(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[dict[str, Any]]]:
        """Makes a step; episodes that are over begin anew."""
        observations, rewards, terminated, truncated, _ = self.vec.step(self.actions)
        done = terminated | truncated
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        for number in np.flatnonzero(done):
            infos[number] = {
                "terminal_observation": observations[number],
                "TimeLimit.truncated": bool(truncated[number] and not terminated[number]),
            }
        if done.any():
            observations, _ = self.vec.reset(options={"reset_mask": done})
        return observations, rewards, done, infos

    def close(self) -> None:
        """Closes the environment."""
        self.vec.close()

    def env_is_wrapped(self, wrapper_class: Any, indices: Any = None) -> list[bool]:
        """No: wrappers are around all of them at once."""
        return [False] * self.num_envs

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """An attribute that all share."""
        return [getattr(self.vec, attr_name)] * self.num_envs

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Sets an attribute that all share."""
        setattr(self.vec, attr_name, value)

    def env_method(self, method_name: str, *arguments: Any, indices: Any = None, **named: Any):
        """Calls a method of them all."""
        return [getattr(self.vec, method_name)(*arguments, **named)]


def make(problem: Any, instance: Any, num_envs: int) -> VecEnv:
    """The vector environment with flat observations and actions, as stable-baselines3 takes it."""
    vec = mdpo_rddl.make_vec(problem, instance, num_envs=num_envs, autoreset_mode="Disabled")
    return ForStableBaselines(FlattenObservation(with_flat_actions(vec)))


def mean_return(agent: PPO, env: VecNormalize) -> float:
    """The mean sum of rewards of the first episode in each environment."""
    env.training = False
    observations, total = env.reset(), np.zeros(env.num_envs)
    running = np.ones(env.num_envs, bool)
    while running.any():
        actions, _ = agent.predict(observations, deterministic=True)
        observations, _, done, _ = env.step(actions)
        total += running * env.get_original_reward()
        running &= ~done
    env.training = True
    return float(total.mean())


def train(make_env: Callable[[], VecEnv], steps: int, policy: str = "MlpPolicy") -> dict:
    """Trains, and says what it took and what it was worth.

    Args:
      make_env: makes the environment to learn in.
      steps: of all episodes together.
      policy: the kind of network.
    """
    env = VecNormalize(make_env())
    per_update = max(2, 2048 // env.num_envs)
    agent = PPO(policy, env, n_steps=per_update, batch_size=256, n_epochs=5, seed=0, device="cpu")
    before = mean_return(agent, env)
    begin = time.perf_counter()
    agent.learn(steps)
    seconds = time.perf_counter() - begin
    return {
        "seconds": seconds,
        "steps a second": agent.num_timesteps / seconds,
        "before": before,
        "after": mean_return(agent, env),
    }


def make_theirs(domain: str, instance: str) -> VecEnv:
    """pyRDDLGym-rl's environment, one episode at a time."""
    import pyRDDLGym
    from pyRDDLGym_rl.core.env import SimplifiedActionRDDLEnv
    from stable_baselines3.common.vec_env import DummyVecEnv

    def one() -> Any:
        env = pyRDDLGym.make(domain, instance, base_class=SimplifiedActionRDDLEnv)
        box = env.action_space
        if not isinstance(box, spaces.Box):
            return env
        bounds = np.maximum(box.low, -LARGEST), np.minimum(box.high, LARGEST)
        bounded = wrappers.TransformAction(env, lambda action: action, spaces.Box(*bounds))
        return wrappers.RescaleAction(bounded, -1.0, 1.0)

    return DummyVecEnv([one])


def compare(domain: str, instance: str, steps: int, num_envs: int, theirs: int) -> list[str]:
    """The rows of a table: ours, and pyRDDLGym-rl's with so many steps unless 0."""
    rows = [("mdpo_rddl.make_vec", num_envs, "MlpPolicy", steps)]
    makers: list[Callable[[], VecEnv]] = [lambda: make(domain, instance, num_envs)]
    if theirs:
        rows.append(("pyRDDLGym-rl", 1, "MultiInputPolicy", theirs))
        makers.append(lambda: make_theirs(domain, instance))
    lines = ["| environment | episodes side by side | steps | steps/s | seconds | before | after |"]
    lines.append("|---|---|---|---|---|---|---|")
    for (name, count, policy, wanted), maker in zip(rows, makers, strict=True):
        got = train(maker, wanted, policy)
        figures = f"{got['steps a second']:,.0f} | {got['seconds']:.1f}"
        returns = f"{got['before']:,.1f} | {got['after']:,.1f}"
        lines.append(f"| {name} | {count} | {wanted:,} | {figures} | {returns} |")
    return lines


def main() -> None:
    """Reads the arguments and prints the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("domain")
    parser.add_argument("instance")
    parser.add_argument("--steps", type=int, default=100_000)
    parser.add_argument("--num-envs", type=int, default=64)
    parser.add_argument("--theirs", type=int, default=0, help="steps for pyRDDLGym-rl, 0 for none")
    chosen = parser.parse_args()
    rows = compare(chosen.domain, chosen.instance, chosen.steps, chosen.num_envs, chosen.theirs)
    print("\n".join(rows))


if __name__ == "__main__":
    main()
