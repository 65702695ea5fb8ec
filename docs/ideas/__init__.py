"""The pictures of the pages on ideas: `branches` along a line of inputs, `folds` over the inputs, the `fall` from one.

They are of one mechanism, `LINE` leads through its inputs in all of them.
"""
