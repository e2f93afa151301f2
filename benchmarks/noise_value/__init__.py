"""What noise is worth: JaxPlan's planner against ours with several rules."""
