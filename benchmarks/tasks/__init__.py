"""Planners on many tasks: every public domain, and those with published returns."""
