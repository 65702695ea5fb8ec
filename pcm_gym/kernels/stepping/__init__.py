"""A step of a batch: increments of the inputs in, verdicts, costs, features and rewards out.

An action is an increment of the inputs in units of the stride, cut to [-1, 1]; a way is the straight line of inputs
that it asks for, and a part of it is a fraction.

To be read in this order: `features` (what is observed), `report` (what is told of a row), `transition` (the step),
`goals` (what is achieved).
"""
