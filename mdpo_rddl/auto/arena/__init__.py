"""Where arms meet: the problem, its compiled planner, the judge and the clock."""
