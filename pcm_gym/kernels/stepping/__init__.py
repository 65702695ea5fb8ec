"""A step of a batch: increments of the inputs in, verdicts, costs, features and rewards out."""
