"""The names that the command line offers, for those who import no JAX."""

DOMAIN_FILES = {
    "hvac10": "hvac.rddl",
    "hvac20": "hvac.rddl",
    "powergen7": "powergen.rddl",
    "powergen11": "powergen.rddl",
    "reservoir15": "reservoir.rddl",
    "reservoir30": "reservoir.rddl",
}
"""The paper's six settings, each with its domain's file."""
