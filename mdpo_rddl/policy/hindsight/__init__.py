"""How much knowing the future would add to a policy's return."""
