"""The learned guess: scenes as tensors, the networks, their training and their use. No pydrake here."""
