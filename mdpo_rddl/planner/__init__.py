"""MDPOPlanner and all that is compiled; the one room that imports JaxPlan."""
