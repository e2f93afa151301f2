"""Search by trials on a ground model whose states are too many to be enumerated."""
