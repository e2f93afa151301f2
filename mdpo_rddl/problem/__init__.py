"""The problem: RDDL files, the exact environment, legal actions, evaluation. No JAX."""
