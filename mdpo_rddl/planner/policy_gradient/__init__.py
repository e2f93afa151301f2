"""The policy gradient by likelihood ratios: the feedback policy as a law of actions, and PPO."""
