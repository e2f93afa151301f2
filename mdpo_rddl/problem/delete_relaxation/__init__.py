"""How far a state is from a reward, if what once was true stayed true: the delete relaxation."""
