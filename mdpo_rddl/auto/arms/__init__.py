"""The parts of the recipe, each a way to find a policy."""
