"""The paper's evaluation: Table 1, its figures, and the evidence for its claims."""
