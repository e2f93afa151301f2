"""Policy iteration on exact rollouts: the greedy policy's value, and the greedy policy of that."""
