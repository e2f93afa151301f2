"""What maps a state to an action: policies, tables, their files, thinking at the decision."""
