"""Thinking at the decision: a prepared policy, improved in the state at hand."""
