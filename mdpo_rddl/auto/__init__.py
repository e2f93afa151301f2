"""The preset `auto`: a good policy from the RDDL alone."""

from mdpo_rddl.auto.recipe import AutoResult, plan_automatically

__all__ = ["AutoResult", "plan_automatically"]
