"""What JaxPlan's compilers lack, and what a model's expressions say."""
