"""From a problem to a policy within a budget, by arms that take turns on the simulator."""
