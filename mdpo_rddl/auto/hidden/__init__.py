"""Planning where the state is observed in part."""
