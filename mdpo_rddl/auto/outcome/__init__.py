"""What a race comes to, also where the judge has played nothing."""
